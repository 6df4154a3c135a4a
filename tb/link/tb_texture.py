"""Bench of the texture packets: which pixels are sent, from which frame, in which packets."""

from dataclasses import replace

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, FallingEdge, First, RisingEdge

from hdl.link.texture import Texture as Block
from hdl.payloads import FrameTag
from model.link import texture_code
from model.link.texture import TEXTURE, TEXTURE_FRAME, Texture, TextureFrame
from model.link.texture_code import BOUNDS, quantise
from tb.harness import Bench, is_high, parameters
from tb.native_block import pack
from tb.preprocessing.frames import BROKEN_GREY, grey_words

SEED = parameters()["seed"]
WIDTH, HEIGHT = parameters()["width"], parameters()["height"]


def words_of(array):
    return [int(word[0]) for word in array]


class Rig(Bench):
    """Sends frames, cuts what comes out into packets, and keeps the model beside them."""

    def __init__(self, dut, gap=0.0, stall=0.0, enable=1):
        super().__init__(dut, gap=gap, stall=stall, seed=SEED, plain={
            "tag": 0, "tripped": 0, "tables_valid": 0, "texture_bound": 0, "texture_mosaic": 0,
            "enable": enable, "bad_sync": 0, "overrun": 0})
        self.np_rng = np.random.default_rng(SEED)
        self.model = Texture(WIDTH, HEIGHT)
        self.number, self.skipped, self.infos, self.images = 0, 0, {}, {}
        self.forms = {}  # bound and mosaic of each frame

    def any_info(self):
        rng = self.np_rng
        return TextureFrame(
            exposure_us=int(rng.integers(1 << 16)), timestamp_us=int(rng.integers(1 << 24)),
            **{name: bool(rng.integers(2)) for name in (
                "broken", "laser", "capture", "tripped", "tables_valid")})

    def any_image(self):
        """Noise, steps, faint noise on a slope, or one grey value."""
        rng, kind = self.np_rng, self.np_rng.integers(5)
        if kind == 0:
            return rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
        if kind == 1:
            return rng.choice(np.array([0, 255], np.uint8), (HEIGHT, WIDTH), p=[0.8, 0.2])
        slope = rng.integers(256) + np.add.outer(
            rng.normal() * np.arange(HEIGHT), rng.normal() * np.arange(WIDTH))
        faint = rng.normal(0, (0, 1, 5)[kind - 2], (HEIGHT, WIDTH))
        return np.clip(slope + faint, 0, 255).astype(np.uint8)

    async def frame(self, image=None, texture=1, cut=None, form=None, **fields):
        """Send a frame; the number that the gate gives it."""
        info = replace(self.any_info(), **fields)
        if image is None:
            image = self.any_image()
        dut = self.dut
        # 1 and 3 act as 0 and 2.
        bound, mosaic = form or (int(self.np_rng.integers(5)), int(self.np_rng.integers(2)))
        dut.texture_bound.value, dut.texture_mosaic.value = bound, mosaic
        dut.tag.value = sum(int(part) << 32 * n for n, part in enumerate(pack(
            FrameTag, texture=texture, laser=info.laser, capture=info.capture,
            exposure_us=info.exposure_us, timestamp_us=info.timestamp_us)[0]))
        dut.tripped.value, dut.tables_valid.value = int(info.tripped), int(info.tables_valid)
        number, self.number = self.number, self.number + 1 & 0xFFFF
        self.infos[number], self.images[number] = replace(info, number=number), image
        self.forms[number] = BOUNDS[bound // 2], mosaic
        words = words_of(grey_words(image))
        if info.broken:
            words = words[:cut or int(self.np_rng.integers(1, len(words)))] + words_of(BROKEN_GREY)
        await self.i.send(words)
        return number

    async def both(self, **fields):
        """A frame to the design and, if it can be taken, to the model."""
        taken = self.model.takes()
        number = await self.frame(**fields)
        if taken:
            self.model.frame(self.images[number],
                             replace(self.infos[number], skipped=self.skipped),
                             *self.forms[number])
        self.skipped = 0 if taken else self.skipped + 1

    async def packet(self):
        """The next packet; the design may send no more than that."""
        self.o.stall = 0.0
        content = []
        while not content or not content[-1] & 0x100:
            content += await self.o.receive(1)
        self.o.stall = 1.0
        return bytes(octet & 0xFF for octet in content)

    async def same(self, count=None):
        """So many packets, or all that the model has, are the model's."""
        sent = []
        while count is None or len(sent) < count:
            expected = self.model.packet()
            if expected is None:
                break
            got = await self.packet()
            assert got == expected, f"got {got.hex()}, not {expected.hex()}"
            sent.append(got)
            await ClockCycles(self.dut.clk, 5)
        return sent

    async def nothing(self):
        await ClockCycles(self.dut.clk, 30)
        assert not self.o.words and not self.dut.o_valid.value


def place_of(content):
    """Row and column of a packet of pixels."""
    head = int.from_bytes(content[1:5], "little")
    return head >> 8 & 1023, head >> 18 & 1023


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def frame_by_frame(dut):
    """All packets between frames; broken frames, patterns between."""
    bench = Rig(dut, stall=1.0)
    await bench.reset()
    for round_ in range(12):
        await bench.both(broken=round_ in (3, 7))
        await bench.frame(texture=0, broken=False)  # numbered, but nothing of it is sent
        await bench.same()
        await bench.nothing()


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def packets_wait_over_frames(dut):
    """Some packets between frames: what waits stays, and new packets take the places that are
    free. Frames that cannot be announced are left out, and counted."""
    bench = Rig(dut, stall=1.0)
    await bench.reset()
    most = 0
    for _ in range(30):
        await bench.both(broken=bool(bench.np_rng.random() < 0.2))
        most = max(most, bench.model.waiting)
        await bench.same(int(bench.np_rng.integers(0, 5)))
        await ClockCycles(dut.clk, 10)
    assert most == 16 or WIDTH * HEIGHT < 1000


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def without_pixels(dut):
    """``enable`` low: frames are announced, no pixels are sent."""
    bench = Rig(dut, stall=1.0, enable=0)
    await bench.reset()
    for number in range(4):
        await bench.frame()
        assert await bench.packet() == bench.infos[number].content()
        await bench.nothing()
    assert not dut.busy.value


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def camera_counters(dut):
    """They are those of the moment in which the packet is offered first."""
    bench = Rig(dut, stall=1.0)
    await bench.reset()
    for bad_sync, overrun in [(0, 0), (1, 2), (255, 254)]:
        dut.bad_sync.value, dut.overrun.value = bad_sync, overrun
        await bench.both(broken=True)
        await ClockCycles(dut.clk, 5)
        dut.bad_sync.value = dut.overrun.value = 77
        assert await bench.packet() == bench.model.packet(bad_sync, overrun)


@cocotb.test(timeout_time=100, timeout_unit="ms")
@cocotb.parametrize(form=[(0, 0), (2, 1), (4, 0)])
async def the_whole_image_goes_round(dut, form):
    """More than once, of every kind of image."""
    bench = Rig(dut, stall=1.0)
    await bench.reset()
    rounds = 0
    while rounds < 2:
        await bench.both(form=form, broken=False)
        await bench.same()
        rounds += bench.model.stands == (0, 0)


@cocotb.test(timeout_time=400, timeout_unit="ms")
@cocotb.parametrize((("gap", "stall"),
                     [(0.0, 0.0), (0.0, 0.97), (0.5, 0.8), (0.9, 0.0), (0.9, 0.97)]))
async def frames_and_packets_at_once(dut, gap, stall):
    """Whatever the speeds: pixels in their order, each from a frame that came whole."""
    bench = Rig(dut, gap, stall)
    await bench.reset()
    sent, passed, ended = [], [], {}

    async def collect():
        while True:
            first = await bench.o.receive(1)
            begin, rest = bench.cycle, []
            while not (first + rest)[-1] & 0x100:
                rest += await bench.o.receive(1)
            sent.append((begin, bytes(octet & 0xFF for octet in first + rest)))

    cocotb.start_soon(collect())
    for _ in range(25):
        passed.append(await bench.frame(broken=bool(bench.np_rng.random() < 0.2)))
        ended[passed[-1]] = bench.cycle
        await ClockCycles(dut.clk, 300 if not stall else int(bench.np_rng.integers(1, 400)))
    busy = True
    while busy:
        if is_high(dut.busy):
            await FallingEdge(dut.busy)
        again, settled = RisingEdge(dut.busy), ClockCycles(dut.clk, 20)
        busy = await First(again, settled) is again

    announced = []
    for _, content in sent:
        if content[0] == TEXTURE_FRAME:
            number = int.from_bytes(content[2:4], "little")
            left_out = number - announced[-1] - 1 if announced else number
            assert content == replace(bench.infos[number], skipped=left_out).content()
            announced.append(number)
    assert announced == passed if not stall else len(announced) > 3
    stands, numbers = (0, 0), []
    for begin, content in sent:
        if content[0] == TEXTURE:
            number = content[1]
            assert place_of(content) == stands, "a pixel is left out or comes twice"
            bound, mosaic = bench.forms[number]
            steps = quantise(bench.images[number], bound).tolist()
            expected, stands, _ = texture_code.pack(
                steps.__getitem__, HEIGHT, *stands, number, bound, mosaic)
            assert content[1:] == expected
            assert not bench.infos[number].broken and ended[number] <= begin
            numbers.append(number)
    assert numbers == sorted(numbers) and len(set(numbers)) > 3


@cocotb.test(timeout_time=50, timeout_unit="ms")
async def clocks(dut):
    """A pixel a clock in; an octet in two clocks out."""
    bench = Rig(dut)
    await bench.reset()
    noise = bench.np_rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
    for _ in range(2):
        await bench.frame(image=noise, form=(0, 0), broken=False)
    assert np.diff(bench.i.taken[:WIDTH * HEIGHT]).max() == 1
    await ClockCycles(dut.clk, 3000)
    assert bench.o.words[0][0] - bench.i.taken[WIDTH * HEIGHT - 1] == Block.latency
    packet, packets = [], 0
    for clock, word in bench.o.words:
        packet.append(clock)
        if word & 0x100:
            assert max(np.diff(packet)) <= 2
            packet, packets = [], packets + 1
    assert packets >= 2


@cocotb.test(timeout_time=50, timeout_unit="ms")
@cocotb.parametrize(clocks=[20, 150, 600])
async def reset_forgets(dut, clocks):
    """... in the middle of a frame, of a packet, or with pixels left."""
    bench = Rig(dut)
    await bench.reset()
    await bench.frame(broken=False)
    dut.i_valid.value = 1
    await ClockCycles(dut.clk, clocks)
    dut.i_valid.value = 0
    bench.o.stall = 1.0
    await bench.reset()
    bench.o.words.clear()
    bench.number = 0
    await bench.both(broken=False)
    await bench.same()
    await bench.nothing()
