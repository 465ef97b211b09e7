"""The compiled moments: the numbers of their definition in torch, whatever the layout; built safely, or not at all."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from torchliner.engine import native
from torchliner.engine.nodes import torch_sums

COMPILER = shutil.which("g++") or shutil.which("clang++")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")
USE = """
import torch
from torchliner.engine import native
print(native.available(), native.reason)
if native.available():
    v = torch.linspace(-5, 5, 300).reshape(1, 10, 30)
    print(float(native.sums(torch.ones(1, 1, 10), v, 24, 0.93).sum()))
"""


def data(slabs: int, rows: int, length: int, width: int, dtype: torch.dtype) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    weights = torch.randn(slabs, rows, length, generator=generator, dtype=dtype)
    weights[:, :, -1] = 0  # padding
    return weights, 2 * torch.randn(slabs, length, width, generator=generator, dtype=dtype)


@needs_compiler
@pytest.mark.parametrize(("dtype", "limit"), [(torch.float32, 2e-6), (torch.float64, 1e-13)])
@pytest.mark.parametrize("rows", [1, 2, 3, 5])
@pytest.mark.parametrize("count", [2, 3, 16, 24, 33, 64])
def test_sums_are_those_of_their_definition(dtype: torch.dtype, limit: float, rows: int, count: int) -> None:
    assert native.available(), native.reason
    weights, v = data(2, rows, 37, 101, dtype)
    found, wanted = native.sums(weights, v, count, 0.93), torch_sums(weights.double(), v.double(), count, 0.93)
    assert found.dtype == torch.float64
    # The derivative of T_k reaches k^2: beyond K = 24 the rounding of v itself is more, in torch as well.
    assert float((found - wanted).abs().max()) < limit * 37 * max(1, count / 24)
    turned = v.transpose(1, 2).contiguous().transpose(1, 2)
    strided = torch.cat([v, v], 2)[:, :, 101:]
    for other in (turned, strided):
        assert torch.equal(native.sums(weights, other, count, 0.93), found)


@needs_compiler
def test_nan_stays_in_its_column() -> None:
    weights, v = data(1, 3, 20, 40, torch.float32)
    clean = native.sums(weights, v, 16, 0.93)
    v[0, 3, 7] = torch.nan
    found = native.sums(weights, v, 16, 0.93)
    assert bool(torch.isnan(found[:, :, 1:, 7]).all())
    others = [i for i in range(40) if i != 7]
    assert torch.equal(found[..., others], clean[..., others])


def test_other_types_shapes_and_devices_are_refused() -> None:
    half = torch.ones(1, 2, 3, dtype=torch.float16)
    for columns in (half, *map(torch.ones, ((1, 3, 3), (2, 2, 3), (2, 3))), torch.ones(1, 2, 3, device="meta")):
        with pytest.raises(ValueError, match=str(columns.dtype)):
            native.sums(torch.ones(1, 1, 2), columns, 16, 0.93)


def used(cache: Path, **environment: str) -> list[str]:
    """What a process of its own prints, with its cache in a folder."""
    about = {**os.environ, "XDG_CACHE_HOME": str(cache), "TORCHLINER_SUMS": "", **environment}
    run = subprocess.run([sys.executable, "-c", USE], env=about, capture_output=True, text=True, check=True)
    return run.stdout.split("\n")[:-1]


@needs_compiler
def test_a_library_is_built_once_for_its_user_alone(tmp_path: Path) -> None:
    whole = used(tmp_path)
    assert whole[0].startswith("True")
    folder = tmp_path / "torchliner"
    assert folder.stat().st_mode & 0o777 == 0o700
    library, checksum = sorted(folder.iterdir(), reverse=True)
    content, made = library.read_bytes(), library.stat().st_mtime_ns
    assert used(tmp_path) == whole
    assert library.stat().st_mtime_ns == made
    for planted in (content[: len(content) // 2], b"planted"):
        library.write_bytes(planted)
        assert used(tmp_path) == whole
        assert library.read_bytes() == content
    checksum.write_bytes(b"\xff\xfe")
    assert used(tmp_path) == whole
    assert len([*folder.iterdir()]) == 2


@needs_compiler
def test_a_folder_that_others_can_write_is_not_used(tmp_path: Path) -> None:
    folder, private = tmp_path / "torchliner", tmp_path / "private"
    folder.mkdir()
    private.mkdir()
    folder.chmod(0o777)
    assert used(tmp_path, TMPDIR=str(private))[0].startswith("True")
    assert not [*folder.iterdir()]
    assert not [*private.iterdir()]


def test_a_command_of_a_compiler_that_is_none_is_the_reason(tmp_path: Path) -> None:
    for command, said in (("g++ '", "False No closing quotation"), ("false", "False false ")):
        assert used(tmp_path, CXX=command)[0].startswith(said)


def test_without_a_compiler_torch_does_it_and_says_why(tmp_path: Path) -> None:
    said = used(tmp_path, PATH=str(tmp_path), CXX="")
    assert said[0].startswith("False no C++ compiler")
    with pytest.raises(subprocess.CalledProcessError):
        used(tmp_path, PATH=str(tmp_path), CXX="", TORCHLINER_SUMS="native")
