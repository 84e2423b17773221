"""The compiled physics as C, for targets that take sources alone."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.export.c_source import kernel_source
from commonrail.plugins.export.library import Library
from commonrail.plugins.export.object_files import compiler_for, find_target, link_shared
from tests.plugins.export.native import BlockRun, Native, Run
from tests.plugins.export.test_library import BOUNDARY

MODULE = """
define hidden noundef i32 @cr_toy(ptr %retptr, ptr %excinfo, ptr %arg.x, i64 %arg.n, double %arg.y) {{
entry:
{body}
}}
"""


def test_the_sources_compile_without_warnings_to_the_same_injection(library: Library, native: Native, own, tmp_path):
    target, name = find_target(own), library.model.name
    sources = [library.folder / f"{name}{part}.c" for part in ("", "_block", "_kernel")]
    out = tmp_path / "from_sources.so"
    link_shared(compiler_for(target), sources, out, target, (f"{name.upper()}_SHARED",))
    from_sources = Native(library._replace(shared={own: out}), own)
    runs = [Run(one, BOUNDARY) for one in (native, from_sources)]
    for run in runs:
        run.plan((0.0, 500e-6))
    seen: list[list[dict[str, float]]] = [[], []]
    for _ in range(60):
        for run, rows in zip(runs, seen, strict=True):
            run.march(20)
            rows.append(run.observe())
    for channel in native.channels:
        one, other = (np.array([row[channel] for row in rows]) for rows in seen)
        np.testing.assert_array_equal(one, other, err_msg=channel)
    assert seen[0][-1]["injected"] > 1e-6
    # a block that was compiled without vectors
    block = BlockRun(from_sources, [BOUNDARY] * 2)
    block.plan(1, (0.0, 500e-6))
    block.march(1200)
    assert from_sources.vectors() == 1
    assert block.observe(1) == runs[1].observe() != block.observe(0)


def test_loops_choices_and_constants_are_translated(tmp_path):
    body = """  br label %loop

loop:                                             ; preds = %loop, %entry
  %i = phi i64 [ 0, %entry ], [ %next, %loop ]
  %sum = phi double [ 0x3FF8000000000000, %entry ], [ %more, %loop ]
  %place = getelementptr inbounds double, ptr %arg.x, i64 %i
  %one = load double, ptr %place, align 8
  %above = fcmp ogt double %one, -2.500000e-01
  %taken = select i1 %above, double %one, double %arg.y
  %more = fadd contract double %sum, %taken
  %next = add nuw nsw i64 %i, 1
  %ends = icmp eq i64 %next, %arg.n
  br i1 %ends, label %out, label %loop, !llvm.loop !3

out:                                              ; preds = %loop
  store double %more, ptr %arg.x, align 8
  ret i32 0"""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler on this machine")
    source = tmp_path / "toy.c"
    main = (
        "#include <stdio.h>\nint main(void) { double x[3] = {1.0, -3.0, 2.0}; "
        'cr_toy(0, 0, (char *)x, 3, 10.0); printf("%.17g", x[0]); return 0; }\n'
    )
    source.write_text(kernel_source(MODULE.format(body=body)) + main)
    subprocess.run([compiler, "-Wall", "-Werror", str(source), "-o", str(tmp_path / "toy"), "-lm"], check=True)
    said = subprocess.run([str(tmp_path / "toy")], capture_output=True, text=True, check=True).stdout
    assert float(said) == 1.5 + 1.0 + 10.0 + 2.0


def test_an_unknown_instruction_is_refused():
    with pytest.raises(ConfigurationError, match="`fence seq_cst`"):
        kernel_source(MODULE.format(body="  fence seq_cst\n  ret i32 0"))
