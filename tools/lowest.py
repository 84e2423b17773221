"""Print the lowest versions that pyproject.toml admits, as constraints for pip: ``python tools/lowest.py > FILE``.

The project's own requirements and those of every extra take part; what they in turn require is left to pip.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(\[[\w,-]+\])?>=(?P<version>[\w.]+)")


def lowest(pyproject: str) -> dict[str, str]:
    """Lowest version of each requirement in the text of a pyproject.toml, by the name of its package in lower case.

    ValueError if one is not of the form ``name>=version``, or two ask for different versions of a package.
    """
    project = tomllib.loads(pyproject)["project"]
    extras = project.get("optional-dependencies", {}).values()
    versions: dict[str, str] = {}
    for requirement in [
        *project["dependencies"],
        *(requirement_of_extra for extra in extras for requirement_of_extra in extra),
    ]:
        match = _REQUIREMENT.fullmatch(requirement)
        if match is None:
            raise ValueError(f'pyproject.toml: requirement "{requirement}" has to be "name>=version".')
        name, version = match["name"].lower(), match["version"]
        if versions.setdefault(name, version) != version:
            raise ValueError(f"pyproject.toml: {name} is required from {versions[name]} and from {version}; state one.")
    return versions


if __name__ == "__main__":
    print("\n".join(f"{name}=={version}" for name, version in lowest(PYPROJECT.read_text(encoding="utf-8")).items()))
