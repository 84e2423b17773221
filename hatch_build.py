"""With COMMONRAIL_BUILD_KERNELS=1 a wheel carries libraries of the compiled simulation and requires no compiler."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

ASKED = "COMMONRAIL_BUILD_KERNELS"
TAG = "COMMONRAIL_WHEEL_TAG"  # such as py3-none-manylinux_2_28_x86_64


def is_asked() -> bool:
    """True if the wheel is to have libraries."""
    return os.environ.get(ASKED) == "1"


class RequirementsHook(MetadataHookInterface):
    """What the package requires: without libraries the compiler of the extra `jit` too."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Enter the requirements."""
        compiler = [] if is_asked() else metadata["optional-dependencies"]["jit"]
        metadata["dependencies"] = [*self.config["dependencies"], *compiler]


class KernelHook(BuildHookInterface):  # type: ignore[type-arg]
    """Libraries of lane loops in a wheel; without being asked it does nothing, and the wheel is pure Python."""

    def dependencies(self) -> list[str]:
        """Packages that the compiler needs in the environment that the wheel is built in."""
        core = self.metadata.core
        return [*core.dependencies, *core.optional_dependencies["jit"]] if is_asked() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile and link the libraries, and put them into the wheel."""
        if not is_asked():
            return
        root = Path(self.root)
        self._made = tempfile.TemporaryDirectory(prefix="commonrail-kernels-")  # removed at the latest with the process
        folder = Path(self._made.name)
        environment = os.environ | {"PYTHONPATH": str(root / "src")}
        command = [sys.executable, "-m", "commonrail.export.lane_library", str(folder), "all"]
        if subprocess.run(command, env=environment, check=False).returncode != 0:
            sys.exit(f"{ASKED}=1 needs the libraries, which were not built: see above; without it the wheel has none.")
        for path in sorted(folder.glob("[!.]*")):  # an interrupted build leaves a hidden file
            build_data["force_include"][str(path)] = f"commonrail/kernels/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = os.environ.get(TAG, "py3-none-linux_x86_64")

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the libraries, which are in the wheel now."""
        if is_asked():
            self._made.cleanup()
