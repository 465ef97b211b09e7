"""
The null test: a hard wall
==========================

Turbulence over a hard wall, without sound and without a liner, educed with the model of a liner:
the method returns an "impedance" here too. It is the response of the model, not a measurement.
"""

import torchliner as tl

plane = tl.read_plane("../../data/channel_y1.04mm.h5")
tl.educe(plane, tl.load_liner("polito"), 1400.0).plot()
