"""Checks of the program, and the paper's study on a virtual test bench."""

from commonrail.plugins.cite.run import Citation as Citation
from commonrail.plugins.cite.run import cite as cite
from commonrail.plugins.doctor.run import Fact as Fact
from commonrail.plugins.doctor.run import doctor as doctor
from commonrail.plugins.paper.bench import PAPER_OPTIMUM as PAPER_OPTIMUM
from commonrail.plugins.paper.bench import Bench as Bench
from commonrail.plugins.paper.bench import Truth as Truth
from commonrail.plugins.paper.bench import bench_curve as bench_curve
from commonrail.plugins.paper.bench_file import load_truth as load_truth
from commonrail.plugins.paper.bench_file import virtual_bench as virtual_bench
from commonrail.plugins.paper.run import Reproduction as Reproduction
from commonrail.plugins.paper.run import reproduce as reproduce
from commonrail.plugins.paper.seeds import SeedProgress as SeedProgress
from commonrail.plugins.paper.seeds import for_seeds as for_seeds
from commonrail.plugins.verification.closed_forms import Check as Check
from commonrail.plugins.verification.run import verify as verify
