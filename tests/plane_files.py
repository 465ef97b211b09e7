"""What the tests of solvers' files share: a plane of known values, and mutations of files."""

from __future__ import annotations

import warnings

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from torchliner.io.plane_format import PlaneRequest

UP = PlaneRequest(normal="y")
FUZZED = settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
X, Z = np.array([0.0, 0.01, 0.02, 0.03]), np.array([-0.005, 0.0, 0.005])
# Points z outside x, in the plane y = 1 mm, and their velocity (T, N, 3), which text tells exactly.
POINTS = np.stack([np.tile(X, 3), np.full(12, 1e-3), np.repeat(Z, 4)], 1)
# Six quadrilaterals between the twelve points, as faces of four corners.
QUADS = np.array([[i, i + 1, i + 5, i + 4] for row in (0, 4) for i in range(row, row + 3)])
VALUES = np.round(np.random.default_rng(3).normal(size=(9, 12, 3)), 4)
STEP = 1e-5
mutations = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), max_size=3)
cuts = st.floats(0.2, 1)


def vectors(values):
    """(u v w) of each row, as OpenFOAM writes them."""
    return [f"({' '.join(f'{n:.10g}' for n in row)})" for row in values]


def recognised(form, path):
    """Whether the format takes a file or folder for its own."""
    return form.recognises(path, b"" if path.is_dir() else path.read_bytes()[:4096])


def opened(form, path, request=UP):
    """The velocity, (..., T), of a plane that its format recognises."""
    assert recognised(form, path)
    return form.open(path, request).load().velocity.numpy()


def mutate(path, marks, cut=1.0):
    """Some bytes of a file replaced, and its end cut off."""
    raw = bytearray(path.read_bytes())
    for place, byte in marks:
        raw[int(place * len(raw))] = byte
    path.write_bytes(raw[: max(1, int(cut * len(raw)))])


def answer_or_error(form, path, request, inside, clean):
    """A mutated file gives an error that names it, or a plane of numbers; never anything else.

    Args:
        form: its format.
        path: what is opened.
        request: as for the clean file.
        inside: name that an error mentions.
        clean: the velocity of the clean file.
    Returns:
        Whether it was the answer to the clean file.
    """
    said = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = form.open(path, request).load().velocity.numpy()
    except (ValueError, OSError) as error:
        said = str(error)
    assert inside in said or not said
    return not said and found.shape == clean.shape and np.array_equal(found, clean)
