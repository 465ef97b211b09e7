"""What is known of a lined duct without solving for its field.

Stated: ``case`` (geometry, flow, source, ends), ``presets`` and ``tables`` (from files),
``wall_impedance`` (Z as a reflection). Modes in uniform flow: ``relation`` (the dispersion relation
as an entire function), ``continuation`` (its roots followed), ``dispersion`` (what is called).
Modes in sheared flow: ``rigid_spectrum`` (between rigid walls), ``pridmore_brown`` (the equation,
by ``chebyshev`` points), ``homotopy`` (from rigid to lined), ``modes`` (what is called).
"""
