import torchliner as tl

curve: tl.LevelCurve = tl.ir_tdibc(tl.load_liner("lbm_slit"), [115, 130, 145], 1400.0)  # dB
print(curve.impedance, curve.rms_speed)
