"""Proves what must hold whatever comes, and shows what each proof costs."""

import argparse
import gc
import sys
import time
import warnings
from dataclasses import dataclass

from amaranth.hdl import Signal, UnusedElaboratable

from hdl.acquisition.frame_banks import FrameBanks
from hdl.acquisition.laser_guard import LaserGuard
from scripts.rtl.blocks import BLOCKS, VARIANTS
from tb.formal import guard_faults, queue_faults
from tb.formal import symbiyosys as formal
from tb.formal.frame_banks import BanksProof
from tb.formal.label_joiner import DEPTH, JoinerProof, joiner_outcome
from tb.formal.laser_guard import Ceilings, GuardProof
from tb.formal.queues import QUEUES
from tb.formal.streams import CASES, Case, ContractProof, stream_ports

__all__ = [
    "GROUPS", "Row", "banks_outcome", "contract_outcome", "guard_fault_outcomes", "guard_outcome",
    "queue_fault_outcome", "queue_outcome", "streaming_blocks",
]

#: Clocks after the start in which a fault planted in the guard has to show.
FAULT_DEPTH = 48


@dataclass(frozen=True)
class Row:
    """A line of the table: what was asked, the result, whether it is the expected one.

    ``seconds`` is None where the line belongs to the run of the one before.
    """

    what: str
    result: str
    seconds: float | None
    good: bool


def guard_outcome(*limits, **options):
    """All properties of the guard at once, by induction over one clock."""
    name = "guard " + (" ".join(map(str, limits)) or "default")
    text = GuardProof(LaserGuard(*limits), Ceilings(*limits)).to_rtlil()
    return formal.prove(name, text, depth=1, **options)


def guard_fault_outcomes(faults=guard_faults.FAULTS, folder="guard faults"):
    """Guards with a planted fault each, their pins alone, from the start on; by its name."""
    texts = {}
    for fault in faults:
        limits = guard_faults.SCALED[fault.scale]
        guard = guard_faults.guard_class(fault)(*limits)
        texts[fault.name] = GuardProof(guard, Ceilings(*limits), fault.breaks, linked=False,
                                       upsets=fault.upset).to_rtlil()
    return formal.refute(folder, texts, FAULT_DEPTH)


def banks_outcome(banks):
    """All properties of the banks of the frame memory, by induction over one step."""
    return formal.prove(f"banks {banks}", formal.to_rtlil(BanksProof(FrameBanks(banks, 1))))


def streaming_blocks():
    """Blocks with a stream that goes out and waits, with these streams' names."""
    found = []
    with warnings.catch_warnings():  # nothing is made of the components that are looked at
        warnings.simplefilter("ignore", UnusedElaboratable)
        for block in (*BLOCKS, *VARIANTS):
            exempt = CASES.get(block.name, Case()).exempt
            names = [name for name, port in stream_ports(block.component())[1].items()
                     if name not in exempt and isinstance(port.ready, Signal)]
            if names:
                found.append((block, names))
        gc.collect()
    return found


def contract_outcome(block):
    """The stream contract at all ports of ``block``."""
    case = CASES.get(block.name, Case())
    text = formal.to_rtlil(ContractProof(block.component(), case))
    if case.bounded:
        return formal.prove(f"contract {block.name}", text, "bmc", case.bounded)
    return formal.prove(f"contract {block.name}", text, depth=1, script=())


def queue_outcome(name):
    """Order, no loss, nothing made up, in the queue ``name``."""
    return formal.prove(f"queue {name}", formal.to_rtlil(QUEUES[name].proof()), depth=1, script=())


def queue_fault_outcome(fault):
    """A queue or a block with a planted fault, from the start on."""
    text = formal.to_rtlil(fault.proof(), fault.breaks)
    return formal.prove(f"fault {fault.what}", text, "bmc", fault.depth)


def _properties(properties, outcome):
    seconds = outcome.seconds
    for name, meaning in properties.items():
        yield Row(f"{name}: {meaning}", outcome.result, seconds, outcome.result == "proved")
        seconds = None


def _found(what, outcome, breaks):
    found = outcome.result == "failed" and outcome.failed and set(outcome.failed) <= set(breaks)
    return Row(what, f"found by {outcome.failed[0]}" if found else outcome.result,
               outcome.seconds, bool(found))


def guard():
    """Laser guard, default ceilings, 16 MHz: any inputs, any power-up, flipped bits."""
    yield from _properties(GuardProof.PROPERTIES, guard_outcome(limit=1200))


def banks():
    """Banks of the frame memory, between any two clocks."""
    for count in (2, 3):
        for row in _properties(BanksProof.PROPERTIES, banks_outcome(count)):
            yield Row(f"{count} banks, {row.what}", row.result, row.seconds, row.good)


def joiner():
    """Label joiner with three labels, for some clocks from the start."""
    outcome = joiner_outcome()
    for row in _properties(JoinerProof.PROPERTIES, outcome):
        yield Row(row.what, f"held for {DEPTH}" if outcome.result == "held" else row.result,
                  row.seconds, outcome.result == "held")


def streams():
    """Stream contract: what is offered stays, unchanged, until it is taken; all ports."""
    for block, names in streaming_blocks():
        outcome = contract_outcome(block)
        bounded = CASES.get(block.name, Case()).bounded
        result = f"held for {bounded}" if outcome.result == "held" else outcome.result
        yield Row(f"{block.name}: {', '.join(names)}", result, outcome.seconds,
                  outcome.result == ("held" if bounded else "proved"))


def queues():
    """Queues: order, no loss, nothing made up; spots = passed on + rejected + dropped."""
    for name, queue in QUEUES.items():
        outcome = queue_outcome(name)
        yield Row(f"{name}: {queue.what}", outcome.result, outcome.seconds,
                  outcome.result == "proved")


def faults():
    """Planted faults, and what finds them from the pins or ports alone."""
    outcomes = guard_fault_outcomes()
    for fault in guard_faults.FAULTS:
        yield _found(f"laser_guard: {fault.name}", outcomes[fault.name], fault.breaks)
    for fault in queue_faults.FAULTS:
        yield _found(fault.what, queue_fault_outcome(fault), fault.breaks)


#: What there is to prove, by name.
GROUPS = {"guard": guard, "banks": banks, "joiner": joiner, "streams": streams,
          "queues": queues, "faults": faults}


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP",
                        help=f"only these of {', '.join(GROUPS)}")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.groups if name not in GROUPS]
    if unknown:
        parser.error(f"There is no group {unknown[0]!r}; there are: {', '.join(GROUPS)}.")
    start, count, bad = time.monotonic(), 0, 0
    for name in options.groups or GROUPS:
        print(GROUPS[name].__doc__.split("\n")[0])
        for row in GROUPS[name]():
            count, bad = count + 1, bad + (not row.good)
            seconds = "" if row.seconds is None else f"{row.seconds:7.1f} s"
            mark = "" if row.good else "  <-"
            print(f"  {row.what:<86} {row.result:<23}{seconds}{mark}".rstrip(), flush=True)
    print(f"{count} lines in {time.monotonic() - start:.0f} s, "
          + (f"{bad} not as they should be" if bad else "all as they should be"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
