"""Bring the compiled moments into a wheel, so that installing it needs no compiler.

    TORCHLINER_PREBUILD=1 python -m pip wheel --no-deps .

Without that variable, and for editable installs, the wheel stays py3-none-any and the moments are built at first use.
"""

import os
import platform
import shlex
import subprocess
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FLAGS = ["-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared"]


class CustomBuildHook(BuildHookInterface):  # type: ignore[misc]
    """Compile torchliner/engine/native.cpp for processors of the last ten years."""

    folder: tempfile.TemporaryDirectory[str] | None = None  # lives until the wheel is packed

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before the wheel is packed; ``version`` is standard or editable."""
        if version == "editable" or os.environ.get("TORCHLINER_PREBUILD") != "1":
            return
        with_avx2 = platform.machine() in ("x86_64", "AMD64")
        name = f"native-{'v3' if with_avx2 else platform.machine()}.so"
        self.folder = tempfile.TemporaryDirectory()
        target = Path(self.folder.name) / name
        source = Path(self.root) / "torchliner" / "engine" / "native.cpp"
        compiler = shlex.split(os.environ.get("CXX", "")) or ["g++"]
        level = ["-march=x86-64-v3"] if with_avx2 else []
        subprocess.run([*compiler, *FLAGS, *level, "-o", target, source], check=True)
        build_data["force_include"][str(target)] = f"torchliner/engine/{name}"
        build_data["pure_python"] = False
        tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        if platform.libc_ver()[0] == "glibc":  # of which the library needs no more than version 2.17
            tag = tag.replace("linux_", "manylinux_2_28_")
        build_data["tag"] = f"py3-none-{tag}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """After it is packed."""
        if self.folder is not None:
            self.folder.cleanup()
