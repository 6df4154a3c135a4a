"""Proves what must hold whatever comes, and shows what each proof costs."""

import argparse
import sys
import time
from dataclasses import dataclass

from hdl.acquisition.laser_guard import LaserGuard
from scripts import formal
from tb.formal.guard_faults import FAULTS, SCALED, guard_class
from tb.formal.laser_guard import GuardProof

__all__ = ["GROUPS", "Row", "fault_outcome", "guard_outcome"]

#: Clocks after the start in which a planted fault has to show.
FAULT_DEPTH = 48


@dataclass(frozen=True)
class Row:
    """A line of the table: what was asked, what came of it, whether that is as it should be."""

    what: str
    result: str
    seconds: float
    good: bool


def guard_outcome(*limits, **options):
    """All properties of the guard at once, by induction over one clock."""
    top = GuardProof(LaserGuard(*limits))
    name = "guard_" + ("_".join(map(str, limits)) or "default")
    return formal.prove(name, formal.to_rtlil(top, top.ports), depth=1, **options)


def fault_outcome(fault):
    """The guard with a planted fault, its pins alone, from the start on."""
    guard = guard_class(fault)(*SCALED[fault.scale])
    top = GuardProof(guard, fault.breaks, linked=False)
    return formal.prove(f"fault {fault.name}", formal.to_rtlil(top, top.ports), "bmc", FAULT_DEPTH)


def guard():
    """Laser guard, by default ceilings at 16 MHz, every input free in every clock."""
    outcome = guard_outcome(limit=1200)
    for name, meaning in GuardProof.PROPERTIES.items():
        yield Row(f"{name}: {meaning}", outcome.result, outcome.seconds,
                  outcome.result == "proved")


def faults():
    """Faults planted in the guard; what finds them."""
    for fault in FAULTS:
        outcome = fault_outcome(fault)
        found = outcome.result == "failed" and set(outcome.failed) <= set(fault.breaks)
        yield Row(fault.name, f"found: {', '.join(outcome.failed)}" if found else outcome.result,
                  outcome.seconds, found and bool(outcome.failed))


#: What there is to prove, by name.
GROUPS = {"guard": guard, "faults": faults}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP",
                        help=f"only these of {', '.join(GROUPS)}")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.groups if name not in GROUPS]
    if unknown:
        parser.error(f"There is no group {unknown[0]!r}; there are: {', '.join(GROUPS)}.")
    start, bad = time.monotonic(), 0
    for name in options.groups or GROUPS:
        print(GROUPS[name].__doc__.split("\n")[0])
        for row in GROUPS[name]():
            bad += not row.good
            print(f"  {row.what:<88} {row.result:<18} {row.seconds:6.1f} s"
                  + ("" if row.good else "  <-"), flush=True)
    print(f"{time.monotonic() - start:.0f} s in all" + (
        f"; {bad} not as they should be" if bad else "; all as it should be"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
