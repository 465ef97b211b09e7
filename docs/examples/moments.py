import torchliner as tl

plane, liner = tl.read_plane("data/slit_n130_y2.5mm.h5"), tl.load_liner("lbm_slit")
known: tl.Moments = tl.moments(plane, liner)  # one reading; then any frequency, any like liner
known.write("moments.h5")
print(tl.read_moments("moments.h5").educe(liner, [1000.0, 1400.0]).answer)

growing = tl.GrowingMoments(plane, cell_pitch=liner.cell_pitch)  # of a plane that is still being written
growing.update(plane.velocity)
print(growing.educe(liner).answer)
