"""The Triton kernel of the sums, without a GPU: in Triton's interpreter, and compiled for an H100."""

import importlib
import os
import subprocess
import sys
from itertools import product

import pytest
import torch

from torchliner.engine import nodes, triton_sums


@pytest.mark.slow
@pytest.mark.parametrize("task", ["interpret", "compile"])
def test_kernel(task, tmp_path):
    pytest.importorskip("triton")
    env = os.environ | {"TRITON_INTERPRET": str(int(task == "interpret")), "TRITON_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, __file__, task], env=env, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"{task} done\n"), done.stderr


def test_without_triton(monkeypatch):
    monkeypatch.setitem(sys.modules, "triton", None)
    monkeypatch.setenv("TRITON_INTERPRET", "1")
    monkeypatch.delitem(sys.modules, triton_sums.__name__)
    found = importlib.import_module(nodes.FASTER["cuda"])
    assert (found.__file__, found.available()) == (triton_sums.__file__, False)


def interpret():
    torch.manual_seed(0)
    assert triton_sums.available()
    for dtype, (rows, count) in product((torch.float32, torch.float64), ((1, 16), (3, 33), (5, 7))):
        columns = 2 * torch.randn(2, 70, 6, dtype=dtype).transpose(1, 2)  # 70: a tile of 64 and a part of one
        columns[1, 2, 3] = torch.nan
        weights = torch.randn(rows, 2, 6, dtype=dtype).transpose(0, 1)
        weights[1, :, 4:] = 0  # a shorter slab
        found = triton_sums.sums(weights, columns, count, 0.3)
        wanted = nodes.torch_sums(weights.double(), columns.double(), count, 0.3)
        assert found.isnan().any(dim=(1, 2)).nonzero().tolist() == [[1, 3]]
        torch.testing.assert_close(found, wanted, rtol=0, atol=6 * count**2 * torch.finfo(dtype).eps, equal_nan=True)


def compile():
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource, compile

    kinds = {"w": "*fp32", "v": "*fp32", "out": "*fp64", "centre": "fp64", "sizes": ("i32",) * 4, "steps": ("i32",) * 6}
    fixed = {"ROWS": 3, "ORDERS": 32, "TILE": triton_sums.TILE}
    source = ASTSource(triton_sums._compiled(), kinds | dict.fromkeys(fixed, "constexpr"), fixed)
    assert compile(source, target=GPUTarget("cuda", 90, 32)).asm["cubin"]


if __name__ == "__main__":
    globals()[sys.argv[1]]()
    print(sys.argv[1], "done")
