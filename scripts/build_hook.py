"""Bring the compiled moments into a wheel, so that installing it needs no compiler.

    TORCHLINER_PREBUILD=1 python -m pip wheel --no-deps .

Without that variable, and for editable installs, the wheel stays py3-none-any and the moments are built at first use.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FLAGS = ["-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared"]


class CustomBuildHook(BuildHookInterface):  # type: ignore[misc]
    """Compile torchliner/engine/native.cpp for processors of the last ten years."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before the wheel is packed; ``version`` is standard or editable."""
        if version == "editable" or not os.environ.get("TORCHLINER_PREBUILD"):
            return
        with_avx2 = platform.machine() in ("x86_64", "AMD64")
        name = f"native-{'v3' if with_avx2 else platform.machine()}.so"
        target = Path(tempfile.mkdtemp()) / name
        source = Path(self.root) / "torchliner" / "engine" / "native.cpp"
        compiler = os.environ.get("CXX", "g++")
        level = ["-march=x86-64-v3"] if with_avx2 else []
        subprocess.run([compiler, *FLAGS, *level, "-o", target, source], check=True)
        build_data["force_include"][str(target)] = f"torchliner/engine/{name}"
        build_data["pure_python"] = False
        tag = sysconfig.get_platform().replace("-", "_").replace(".", "_").replace("linux_", "manylinux_2_28_")
        build_data["tag"] = f"py3-none-{tag}"
