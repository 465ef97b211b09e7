"""A straight duct with a liner on one wall: flow, modes, sound field.

Flow: ``flow_profiles``, ``law_of_the_wall``, ``tabulated_profile``. Stated ducts: ``case`` (geometry, source, ends),
``presets`` and ``tables`` (from files), ``wall_impedance`` (Z as a reflection). Modes in uniform flow: ``relation``
(the dispersion relation as an entire function), ``dispersion`` (what is called). Modes in sheared flow:
``rigid_spectrum`` (between rigid walls), ``pridmore_brown`` (the equation), ``modes`` (what is called),
``growing_wave``. ``roots`` follows the roots of both, ``polynomials`` serves panels and elements. The linearised
Euler equations, condensed column by column: ``mesh``, ``basis``, ``columns``, ``sweep`` (all columns, for every unit
wave into the duct), ``ends`` and ``boundaries`` (what comes back there), ``energy``, ``solver`` and ``settled`` (what
is called) and ``field`` (what it returns).
"""
