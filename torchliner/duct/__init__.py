"""A straight duct with a liner on one wall: flow, modes, sound field.

Flow: ``flow_profiles``, ``law_of_the_wall``, ``tabulated_profile``. Stated ducts: ``case`` (geometry, source, ends),
``presets`` and ``tables`` (from files), ``wall_impedance`` (Z as a reflection). Modes: ``dispersion`` (uniform flow, in
closed form), ``modes`` (sheared flow: ``pridmore_brown`` is the equation, ``rigid_spectrum`` the start),
``growing_wave``; ``roots`` follows the roots of both. The linearised Euler equations, condensed column by column:
``mesh``, ``polynomials``, ``columns``, ``sweep`` (all columns, for every unit wave into the duct), ``boundaries`` (what
comes back from walls and ends, and its energy), ``solver`` and ``settled`` (what is called), ``field`` (what it
returns) and ``doubts`` (what is warned of).
"""
