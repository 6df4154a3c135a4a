import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, ReadOnly, RisingEdge

from hdl.acquisition.frame_gate import FrameGate
from hdl.payloads import FrameInfo, FrameTag, GreyPixel
from model.acquisition.frame_gate import LEFT_OUT, gate
from tb.harness import Bench, parameters
from tb.native_block import pack
from tb.preprocessing.frames import BROKEN_GREY, grey_words


def words_of(array):
    return [int(word[0]) for word in array]


class Reader:
    """The queues behind both announcements: take at once or not at all."""

    def __init__(self, bench):
        self.bench, self.taken = bench, []
        cocotb.start_soon(self._run())

    async def _run(self):
        dut = self.bench.dut
        while True:
            await ReadOnly()
            for name in ("info", "texture_info"):
                valid, ready, payload = (
                    getattr(dut, f"{name}_{part}") for part in ("valid", "ready", "payload"))
                if not dut.rst.value and valid.value and ready.value:
                    self.taken.append((name, payload.value.to_unsigned()))
            await RisingEdge(dut.clk)


def word_of(shape, **fields):
    return sum(int(part) << 32 * n for n, part in enumerate(pack(shape, **fields)[0]))


def random_tag(rng):
    """Fields of a FrameTag."""
    bits = {"texture": 1, "laser": 1, "capture": 1, "exposure_us": 16, "timestamp_us": 24}
    return {name: int(rng.integers(1 << width)) for name, width in bits.items()}


PLAIN = {"info_ready": 1, "texture_info_ready": 1, "tag": 0,
         "tripped": 0, "tables_valid": 0, "pattern_every": 0}


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(gap=[0.0, 0.4], stall=[0.0, 0.4])
async def whole_frames_or_none(dut, gap, stall):
    """Frames of both kinds, whole, broken, and broken before they began; room or not."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = Bench(dut, outputs=("o", "texture"), gap=gap, stall=stall, seed=parameters()["seed"],
                  plain=PLAIN)
    reader = Reader(bench)
    await bench.reset()
    frames, wanted, states, words_of_frames = [], {"o": [], "texture": []}, [], []
    every = 1
    for _ in range(80):
        image = rng.integers(0, 256, (3, 4)).astype(np.uint8)
        words = words_of(grey_words(image))
        broken = words_of(BROKEN_GREY)
        kind = rng.choice(["whole", "whole", "broken", "nothing"])
        if kind == "broken":
            words = words[:int(rng.integers(1, 12))] + broken
        elif kind == "nothing":
            words = broken
        ready, tag = bool(rng.random() < 0.6), random_tag(rng)
        tripped, tables_valid = int(rng.integers(2)), int(rng.integers(2))
        # Only the announcement of the frame's own kind may matter.
        dut.info_ready.value = ready ^ tag["texture"]
        dut.texture_info_ready.value = ready ^ 1 ^ tag["texture"]
        dut.tag.value = word_of(FrameTag, **tag)
        dut.tripped.value, dut.tables_valid.value = tripped, tables_valid
        if rng.random() < 0.2:
            every = int(rng.choice([0, 1, 2, 3, 5, 15]))
        dut.pattern_every.value = every
        if kind != "nothing":
            frames.append((ready, not tag["texture"], every))
            states.append({"tripped": tripped, "tables_valid": tables_valid, "every": every,
                           **{f"tag_{name}": value for name, value in tag.items()}})
            words_of_frames.append(words)
        first, then = words[:1], words[1:]
        await bench.i.send(first)
        if then:
            # What the tag becomes within the frame is not its matter.
            dut.tag.value = word_of(FrameTag, **random_tag(rng))
            await bench.i.send(then)
        if gap or stall:  # the frame's own pixels must not hurt later ones
            await ClockCycles(dut.clk, int(rng.integers(0, 3)))
    passed = gate(*zip(*frames, strict=True))
    for entry, state, words in zip(passed, states, words_of_frames, strict=True):
        if entry:
            wanted["texture" if state["tag_texture"] else "o"] += words
    for name in wanted:
        assert await getattr(bench, name).receive(len(wanted[name])) == wanted[name]
    await ClockCycles(dut.clk, 20)
    assert not bench.o.words and not bench.texture.words
    announced = [
        ("texture_info" if state["tag_texture"] else "info",
         word_of(FrameInfo, number=entry[0], skipped=entry[1], **state))
        for entry, state in zip(passed, states, strict=True) if entry]
    assert reader.taken == announced
    assert dut.lost.value == passed.count(None) and passed.count(LEFT_OUT) > 5


@cocotb.test(timeout_time=10, timeout_unit="ms")
@cocotb.parametrize(texture=[0, 1])
async def a_pixel_a_clock(dut, texture):
    """Nothing waits, passing or not; a whole frame costs as many clocks as it has pixels."""
    rng = np.random.default_rng(parameters()["seed"])
    bench = Bench(dut, outputs=("o", "texture"), plain=PLAIN | {"tag": texture})
    await bench.reset()
    words = words_of(grey_words(rng.integers(0, 256, (8, 16)).astype(np.uint8))) * 3
    mine, other = (bench.texture, bench.o) if texture else (bench.o, bench.texture)
    other.stall = 1.0  # the other kind's reader does not matter
    await bench.i.send(words)
    assert bench.i.taken[-1] - bench.i.taken[0] == len(words) - 1
    await ClockCycles(dut.clk, 2)
    assert [clock - FrameGate.latency for clock, _ in mine.words] == bench.i.taken
    (dut.texture_info_ready if texture else dut.info_ready).value = 0
    first = len(bench.i.taken)
    mine.stall = 1.0  # what is discarded does not wait for the reader either
    await ClockCycles(dut.clk, 2)
    await bench.i.send(words)
    assert bench.i.taken[-1] - bench.i.taken[first] == len(words) - 1


@cocotb.test(timeout_time=10, timeout_unit="ms")
async def skipped_stops_at_255(dut):
    """... and is reported with the next frame that passes, of whichever kind."""
    bench = Bench(dut, outputs=("o", "texture"),
                  plain=PLAIN | {"info_ready": 0, "texture_info_ready": 0})
    reader = Reader(bench)
    await bench.reset()
    pixel = int(pack(GreyPixel, marker_line_end=[1], marker_frame_end=[1])[0][0])
    await bench.i.send([pixel] * 300)
    assert dut.lost.value == 255
    dut.info_ready.value = dut.texture_info_ready.value = 1
    await bench.i.send([pixel])
    dut.tag.value = 1
    await bench.i.send([pixel])
    assert reader.taken == [
        ("info", word_of(FrameInfo, number=300, skipped=255)),
        ("texture_info", word_of(FrameInfo, number=301, tag_texture=1))]
