"""A binding is named after the thing it holds, not after how it came to be held."""

import ast
from pathlib import Path

import commonrail

PACKAGE = Path(commonrail.__file__).parent
LISTED = {
    *("found", "own", "known", "given", "wanted", "held", "kept", "told", "made", "apart"),
    *("whole", "part", "one", "named", "chosen", "there", "off", "how"),
}
# Names that a file or the command line fixes, and few others.
ALLOWED = {
    ("calibration/parameter.py", "wanted"),  # in the fingerprint of a study
    ("calibration/study_keys.py", "wanted"),  # a key of the study file
    ("plugins/family/injector_type.py", "part"),  # a key of the type file
    ("plugins/family/study.py", "part"),  # a key of the family file
    ("plugins/observer/verb.py", "wanted"),  # the option --wanted
    ("plugins/plans/verb.py", "part"),
    ("plugins/plans/study.py", "chosen"),
    ("plugins/tolerance/trim.py", "held"),
    ("plugins/tolerance/page.py", "held"),
    ("plugins/fleet/page.py", "apart"),
}


def bound_names(tree: ast.AST) -> set[str]:
    """Names of variables, parameters, fields, functions and classes that a module binds."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
    return names


def test_no_binding_has_a_listed_name() -> None:
    listed = {
        (path.relative_to(PACKAGE).as_posix(), name)
        for path in PACKAGE.rglob("*.py")
        for name in bound_names(ast.parse(path.read_text(encoding="utf-8"))) & LISTED
    }
    assert sorted(listed - ALLOWED) == []
