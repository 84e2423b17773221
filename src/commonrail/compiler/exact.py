"""Kernels whose bits do not depend on the processor.

Additions, products, divisions and roots are rounded alike by every processor (IEEE 754). Processors give other bits
where the compiler fuses a product and a sum, or reorders operations, as it finds best for each. A kernel of
`exact_processor` is compiled without either. The elementary functions of the C library, which has several versions of
each and takes one by processor, are replaced by those of `physics.elementary` in every kernel of lanes and exports.
"""

from __future__ import annotations

import platform

from commonrail.base.errors import ConfigurationError
from commonrail.compiler.target import Processor, is_x86, own_processor


def missing() -> str | None:
    """Sentence on why no bits are promised on this machine; None where they are."""
    if is_x86():
        return None
    return (
        f"The same bits are promised for x86-64 processors, and this machine is of kind {platform.machine()}; "
        "omit same_bits."
    )


def exact_processor() -> Processor:
    """This machine's processor, for kernels whose bits are those of every other; loads llvmlite.

    Raises
    ------
    ConfigurationError
        If this machine is of another kind.
    """
    fault = missing()
    if fault is not None:
        raise ConfigurationError(fault)
    return own_processor()._replace(exact=True)
