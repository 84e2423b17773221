"""With COMMONRAIL_BUILD_KERNELS=1 a wheel carries libraries of the compiled simulation and requires no compiler."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ASKED = "COMMONRAIL_BUILD_KERNELS"
EXTRA = "jit"
TAG = "COMMONRAIL_WHEEL_TAG"  # such as py3-none-manylinux_2_28_x86_64


class KernelHook(BuildHookInterface):  # type: ignore[type-arg]
    """Libraries of lane loops in a wheel; without being asked it does nothing, and the wheel is pure Python."""

    def dependencies(self) -> list[str]:
        """Packages that the compiler needs in the environment that the wheel is built in."""
        return list(self.metadata.core.dependencies) if self._is_asked() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile and link the libraries, and put them into the wheel, which then requires no compiler."""
        if not self._is_asked() or version == "editable":  # whose libraries `make kernels` builds beside the sources
            return
        root = Path(self.root)
        self._made = tempfile.TemporaryDirectory(prefix="commonrail-kernels-")  # removed at the latest with the process
        folder = Path(self._made.name)
        environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(root / "src"), self.root))}
        command = [sys.executable, "-m", "tools.wheel_libraries", str(folder), "all"]
        if subprocess.run(command, env=environment, check=False).returncode != 0:
            sys.exit(f"{ASKED}=1 needs the libraries, which were not built: see above; without it the wheel has none.")
        for path in sorted(folder.glob("[!.]*")):  # an interrupted build leaves a hidden file
            build_data["force_include"][str(path)] = f"commonrail/kernels/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = os.environ.get(TAG, "py3-none-linux_x86_64")
        self._free_of_the_compiler()

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the libraries, which are in the wheel now."""
        if hasattr(self, "_made"):
            self._made.cleanup()
            for own, before in self._requirements:  # of a source distribution that is built next
                own[:] = before

    def _free_of_the_compiler(self) -> None:
        """Require no compiler; extras name the versions that made the libraries, which others are not used with."""
        core = self.metadata.core
        compiler = list(core.optional_dependencies[EXTRA])
        versions = [f"{package}=={importlib.metadata.version(package)}" for package in ("llvmlite", "numba")]
        lists = [core.dependencies, *core.optional_dependencies.values()]
        self._requirements = [(own, list(own)) for own in lists]
        core.dependencies[:] = [one for one in core.dependencies if one not in compiler]
        for extra in core.optional_dependencies.values():
            if any(one in compiler for one in extra):
                extra[:] = [*versions, *(one for one in extra if one not in compiler)]

    @staticmethod
    def _is_asked() -> bool:
        return os.environ.get(ASKED) == "1"
