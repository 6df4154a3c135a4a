"""Packed pixels: the model against bits written out, the reader against both."""

import cv2
import numpy as np
import pytest
from amaranth.hdl import Module, Signal
from amaranth.sim import Simulator

from hdl.link.texture_code import quantise as block
from hdl.protocol import PacketKind
from model.link.texture import Texture, TextureFrame
from model.link.texture_code import BOUNDS, quantise
from scripts.host.decoder import Decoder
from scripts.host.texture_packet import unpack
from tb.link.texture_bits import bits_of_rows, head
from tb.link.wire import Wire

#: Steps of rows (the first one from its packet's first pixel on), mosaic, the codes of them.
WRITTEN_OUT = {
    # 100 as it is; no difference, with a remainder of one bit; then the activity is below 8: +1
    # folds to 2, two zeros, and no pixel waits; two pixels without a difference are one bit.
    "a calm row": ([[100, 100, 101, 101, 101]], False, "1 00100110" "10" "0010" "1"),
    # A pair without a difference; one that waits, and -1, which folds to 1.
    "a step down": ([[9, 9, 9, 9, 9, 8]], False, "1 10010000" "10" "1" "011"),
    # From 0 to 255 folds to 510: six zeros and the value. Remainders then have seven bits.
    "an edge": ([[0, 255, 255]], False, "1 00000000" "0000001 11111111" "1 0000000"),
    # Both colours as they are, then each like the one two before; one waits when the row ends.
    "a mosaic": ([[3, 7, 3, 7, 3, 7], [3, 7]], True,
                 "1 11000000" "1 11100000" "10" "1" "00000001 1" "1"),
}


def bodies(image, bound, mosaic, number=5):
    """Packets of a whole image, one pass after the other."""
    texture, found = Texture(image.shape[1], image.shape[0]), []
    while not found or texture.stands != (0, 0):
        texture.frame(image, TextureFrame(number=number), bound, mosaic)
        while (content := texture.packet()) is not None:
            if content[0] == PacketKind.TEXTURE:
                found.append(content[1:])
    return found


def images():
    """Pictures that are calm, steep, hostile, and of odd sizes."""
    rng = np.random.default_rng(1)
    calm = cv2.resize(rng.normal(128, 60, (9, 11)), (61, 45), interpolation=cv2.INTER_CUBIC)
    yield "calm", np.clip(calm, 0, 255).astype(np.uint8)
    yield "faint noise", np.clip(calm + rng.normal(0, 2, calm.shape), 0, 255).astype(np.uint8)
    yield "noise", rng.integers(0, 256, (37, 352)).astype(np.uint8)
    yield "black and white", rng.choice(np.array([0, 255], np.uint8), (16, 64))
    yield "edges", np.kron(rng.integers(0, 256, (6, 9)), np.ones((7, 5), int)).astype(np.uint8)
    yield "white", np.full((19, 16), 255, np.uint8)
    yield "all values", np.arange(16 * 256).reshape(16, 256).astype(np.uint8)


IMAGES = dict(images())


@pytest.mark.parametrize("name", WRITTEN_OUT)
def test_packets_written_out(name):
    rows, mosaic, text = WRITTEN_OUT[name]
    bits = text.replace(" ", "")
    assert "".join(bits_of_rows(rows, mosaic)) == bits
    bits += "0" * (-len(bits) % 32)
    octets = head(9, 4, 3, 0, mosaic) + int(bits[::-1], 2).to_bytes(len(bits) // 8, "little")
    pieces = unpack(octets)
    places = [(4, 3), (12, 0)]
    assert [(row, column, grey.tolist()) for row, column, grey in pieces] == [
        (*place, row) for place, row in zip(places, rows, strict=False)]


@pytest.mark.parametrize("mosaic", [False, True])
@pytest.mark.parametrize("bound", BOUNDS)
@pytest.mark.parametrize("name", IMAGES)
def test_a_whole_image(name, bound, mosaic):
    """Every pixel once, no error above the bound, and the bits are those of the description."""
    image = IMAGES[name]
    got = np.full(image.shape, -1)
    for body in bodies(image, bound, mosaic):
        pieces = unpack(body)
        first = pieces[0]
        assert body[:4] == head(5, first[0], first[1], bound, mosaic)
        steps = []
        for row, column, grey in pieces:
            part = np.s_[row, column:column + len(grey)]
            assert (got[part] == -1).all()
            got[part] = grey
            assert np.abs(got[part] - image[part].astype(int)).max() <= bound
            steps.append(quantise(image[part], bound).tolist())
        bits = "".join(f"{octet:08b}"[::-1] for octet in body[4:])
        codes = "".join(bits_of_rows(steps, mosaic))
        ended = bits[len(codes):]
        # The row may end with the packet; then there are only zeros.
        assert bits.startswith(codes) and len(body) <= 88
        assert not ended.strip("0") or ended.rstrip("0") in ("00000001", "000000011")
    assert (got >= 0).all()


def test_a_coarse_picture_comes_first():
    rows = [row for body in bodies(IMAGES["noise"], 0, False) for row, _, _ in unpack(body)]
    wanted = [*range(0, 37, 8), *range(4, 37, 8), *range(2, 37, 4), *range(1, 37, 2)]
    assert list(dict.fromkeys(rows)) == wanted


@pytest.mark.parametrize("seed", range(3))
def test_lost_packets_cost_their_pixels(seed):
    rng = np.random.default_rng(seed)
    image, wire, decoder = IMAGES["faint noise"], Wire(), Decoder()
    got, lost = np.full(image.shape, -1), np.zeros(image.shape, bool)
    for body in bodies(image, 2, False):
        octets = wire.packet(PacketKind.TEXTURE, body)
        if rng.random() < 0.3:
            for row, column, grey in unpack(body):
                lost[row, column:column + len(grey)] = True
            continue
        for piece in decoder.events(octets):
            got[piece.row, piece.column:piece.column + len(piece.pixels)] = piece.pixels
    assert lost.any() and ((got < 0) == lost).all()
    assert np.abs(got - image.astype(int))[~lost].max() <= 2


@pytest.mark.parametrize("seed", range(4))
def test_hostile_packets(seed):
    """Right by their check, packed by nobody: each is pieces of rows or one unknown packet."""
    rng = np.random.default_rng(seed)
    wire, decoder = Wire(), Decoder()
    good = bodies(IMAGES["faint noise"], 2, bool(seed & 1))
    refused = 0
    for _ in range(500):
        body = bytearray(good[rng.integers(len(good))])
        for _ in range(rng.integers(1, 4)):
            body[rng.integers(len(body))] = rng.integers(256)
        if rng.random() < 0.3:
            body = rng.integers(0, 256, rng.integers(1, 91), np.uint8).tobytes()
        before = decoder.unknown
        pieces = decoder.events(wire.packet(PacketKind.TEXTURE, bytes(body)))
        assert decoder.unknown - before == (not pieces)
        assert sum(len(piece.pixels) for piece in pieces) <= 2 * 8 * 84
        refused += not pieces
    assert 0 < refused < 500
    assert decoder.damaged == decoder.garbage == decoder.lost == 0


@pytest.mark.parametrize("octets", [
    "0500000000000000", "05000030ff010000", "0500008001020000", "0500000002000000", "05000000",
    "05000010ff010000", "0500000000"], ids=[
    "no pixel", "no such bound", "no such form", "a row's end first", "a head alone",
    "a value above the largest", "part of a word"])
def test_impossible_packets(octets):
    assert not unpack(bytes.fromhex(octets))


def test_numbers_of_steps():
    """The block's arithmetic without a division, for every grey value and bound."""
    m, grey, bound, step = Module(), Signal(8), Signal(3), Signal(8)
    m.d.comb += step.eq(block(grey, bound))
    found = {}

    async def bench(context):
        for value in range(5):
            context.set(bound, value)
            for level in range(256):
                context.set(grey, level)
                found[value, level] = context.get(step)

    simulator = Simulator(m)
    simulator.add_testbench(bench)
    simulator.run()
    for (value, level), got in found.items():
        width = 2 * BOUNDS[value // 2] + 1
        assert abs(got * width - level) <= width // 2
        assert got == quantise(np.array(level), BOUNDS[value // 2])
