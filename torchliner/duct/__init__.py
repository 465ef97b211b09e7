"""A straight duct with a liner on one wall: flow, modes, sound field.

Flow: ``flow_profiles`` and ``tables``. Stated ducts: ``case`` (geometry, source, ends, Z as a reflection) and
``presets`` (from files). Modes: ``dispersion`` (uniform flow, in closed form), ``modes`` (sheared flow),
``growing_wave``; ``roots`` follows the roots of both. The linearised Euler equations, condensed column by column:
``mesh``, ``polynomials``, ``columns``, ``sweep`` (all columns, for every unit wave into the duct), ``boundaries`` (what
comes back from walls and ends, and its energy), ``solver`` and ``settled`` (what is called), ``doubts`` (what is warned
of) and ``solved_line`` (what is written).
"""
