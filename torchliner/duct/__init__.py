"""A straight duct with a liner on one wall: flow, modes, sound field.

``flow_profiles``; ``case`` and ``presets`` (stated in code, in files); ``dispersion`` (uniform flow) and ``modes``
(sheared flow), whose roots ``numerics`` follows; the linearised Euler equations: ``mesh``, ``columns``, ``sweep`` (all
columns, for every unit wave), ``solver`` (walls and ends), ``field``, ``settled`` (a second mesh).
"""
