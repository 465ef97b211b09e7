"""A straight duct with a liner on one wall: flow, modes, sound field.

Flow: ``flow_profiles``, ``tabulated_profile``. Stated ducts: ``case`` (geometry, source, ends), ``presets`` and
``tables`` (from files), ``wall_impedance`` (Z as a reflection). Modes in uniform flow: ``relation`` (the dispersion
relation as an entire function), ``dispersion`` (what is called). Modes in sheared flow: ``rigid_spectrum`` (between
rigid walls), ``pridmore_brown`` (the equation, by ``chebyshev`` points), ``modes`` (what is called). The linearised
Euler equations, condensed column by column: ``mesh``, ``columns``, ``sweep`` (all columns, for every unit wave into the
duct), ``walls`` and ``ends`` (what comes back there), ``solver`` (what is called) and ``field`` (what it returns).
"""
