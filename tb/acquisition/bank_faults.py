"""Faults that one could make in the sharing of banks, planted to see the benches find them."""

from pathlib import Path

from hdl.acquisition import frame_banks

__all__ = ["FAULTS", "planted"]

#: By name: the right text of hdl/acquisition/frame_banks.py, and the wrong one.
FAULTS = {
    "the writer takes the reader's bank": (
        "if number not in (written, held)]", "if number != written]"),
    "the reader does not wait for the answer": (
        "with m.If(request & answer_synced):", "with m.If(request):"),
    "the reader keeps reading while it asks": (
        "wants.eq(self.acquire), self.held.eq(0)]", "wants.eq(self.acquire)]"),
    "an answer for a request that has gone": (
        "self.idle.eq(~request & ~answer_synced)", "self.idle.eq(~request)"),
    "frames go to any bank": (
        "m.d.sync += [self.write_bank.eq(~newest), self.free.eq(1)]",
        "m.d.sync += self.free.eq(1)"),
    "the newest frame is given away": (
        "if number not in (written, held)]", "if number != held]"),
}


def planted(fault, *arguments):
    """A FrameBanks with a fault."""
    right, wrong = FAULTS[fault]
    text = Path(frame_banks.__file__).read_text()
    assert text.count(right) == 1, f"the design has changed: {right!r} is not in it once"
    scope = {"__name__": frame_banks.__name__, "__package__": frame_banks.__package__}
    exec(compile(text.replace(right, wrong), frame_banks.__file__, "exec"), scope)
    return scope["FrameBanks"](*arguments)
