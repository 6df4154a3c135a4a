"""The whole instrument for system benches: an imager that plays images, a host that keeps watch."""

import numpy as np

from hdl.paper_points import REMAP_BASE
from hdl.protocol import REMAP
from model.capsule import Capsule as Model
from model.preprocessing.remap import pack_remap
from scripts.host.commands import Commands
from scripts.host.decoder import Decoder, Frame, TextureFrame
from scripts.host.loading import signed
from scripts.host.rebuild import Rebuilder
from scripts.simulation.instrument import Instrument, Line

__all__ = ["Whole", "same"]

#: The laser guard's ceilings in microseconds, and what the driver adds to a pulse: it takes a while
#: to notice that the pin stands still.
PULSE_US, REPETITION_US, WINDOW_US, WINDOW_ON_US, HOLD_US = 1000, 20_000, 40_000, 1000, 0.5


def same(frame, wanted):
    """A decoded frame against the model's, every number of it."""
    status = wanted.points["status"]
    counts = [np.count_nonzero(status == code) for code in range(4)]
    listed = wanted.points
    if frame.compact:
        listed = np.concatenate([listed[status == 0], listed[status != 0][:9]])
        ok = listed["status"] == 0
        listed["beam"][~ok] = frame.points["beam"][~ok] if len(frame.points) == len(ok) else 0
    return (frame.level, frame.grey_noise, frame.saturated, frame.spots, frame.ok, frame.noise,
            frame.ambiguous, frame.rejected, frame.dropped, frame.learning) == (
        wanted.level, wanted.grey_noise, wanted.saturated, wanted.spots, *counts[:3],
        counts[3] + wanted.rejected, wanted.dropped, wanted.learning) and np.array_equal(
            frame.points, listed) and frame.verified is True


class Whole:
    """An instrument with its host.

    Parameters
    ----------
    config : :class:`hdl.config.Config`
        Constructor choices.
    settings : :class:`model.settings.Settings`
        Registers and tables.
    images : sequence of array (height, width) of uint8
        Pattern frames, shown in turn.
    texture : array (height, width) of uint8
        What a texture frame shows.
    load : :class:`bool`
        Load and commit the tables.
    places_in_memory : :class:`bool`
        Put the remap table into the external memory without sending most of it, to save time:
        only the packets with its first and its last word, and those whose number is a power of two.
    registers : :class:`int`
        Further registers.
    """

    def __init__(self, config, settings, images, texture=None, load=True, line_blanking=0,
                 places_in_memory=False, **registers):
        self.config, self.settings, self.images = config, settings, images
        blank = np.full((config.height, config.width), 40, np.uint8)
        self.texture = blank if texture is None else texture
        #: (image or None for a texture, microseconds integrated, microseconds lit) of every frame.
        self.shown = []
        #: How many of them came during the last COMMIT.
        self.shown_meanwhile = 0
        self.instrument = Instrument(config, self._picture, line_blanking=line_blanking)
        self._places_in_memory = places_in_memory
        if places_in_memory:
            self.instrument.fill_memory(REMAP_BASE, pack_remap(settings.remap))
        self.line = Line(self.instrument, step_us=100)
        self.commands = Commands(self.line, timeout=120, patience=120)
        self.decoder = Decoder(Rebuilder(settings, config.width, config.height))
        #: What is seen of an image that was lit for so many microseconds.
        self.light = lambda image, lit_us: image
        self.events = []
        self._decoded = 0
        self._patterns = 0
        if load:
            self.load(settings)
        mode = registers.pop("mode", 0)
        for name, value in {**settings.registers(), **registers, "mode": mode}.items():
            self.commands.write(name, signed(name, value))

    def load(self, settings, damage=None, not_banked=True):
        """Load and commit tables; ``damage`` may change their words after the CRC was made.

        Those that have one bank cannot be written while frames pass.
        """
        config, words = self.config, settings.tables()
        sent = damage(words) if damage else words
        self.commands.begin(config.width, config.height, config.beams)
        for table, first, some in self.commands.chunks(sent):
            if not not_banked and not table.banked:
                continue
            if table == REMAP and self._places_in_memory:
                # Spoilt before, they are right again only if they come to where they belong.
                last = first + len(some) - 1
                if first and last != len(sent[table.name]) - 1 and (
                        (first - 1).bit_length() == last.bit_length()):
                    continue
                halves = np.array(some, "<u8").view("<u4")
                self.instrument.fill_memory(REMAP_BASE + 2 * first, ~halves)
            self.commands.write_table(table, first, some)
        shown = len(self.shown)
        self.commands.commit(words)
        self.shown_meanwhile = len(self.shown) - shown

    def _picture(self, integrated_us, lit_us):
        if integrated_us > 3000:
            self.shown.append((None, integrated_us, lit_us))
            return self.texture
        image = self.light(self.images[self._patterns % len(self.images)], lit_us)
        self._patterns += 1
        self.shown.append((image, integrated_us, lit_us))
        return image

    def run(self, microseconds):
        """Let time pass; decode what comes."""
        end = self.instrument.clocks + round(microseconds * self.config.clock_hz / 1e6)
        while self.instrument.clocks < end:
            self.line.read()
        self.take()

    def take(self):
        """Decode what came."""
        self.events += self.decoder.events(self.line.record[self._decoded:])
        self._decoded = len(self.line.record)

    @property
    def now_us(self):
        """Microseconds since power-up."""
        return self.instrument.clocks * 1e6 / self.config.clock_hz

    @property
    def frames(self):
        """Decoded pattern frames."""
        return [event for event in self.events if isinstance(event, Frame)]

    @property
    def textures(self):
        """Announced texture frames."""
        return [event for event in self.events if isinstance(event, TextureFrame)]

    def assert_link_is_clean(self):
        """Nothing on the line but whole packets of good numbers."""
        decoder = self.decoder
        assert not self.instrument.framing_errors
        assert (decoder.damaged, decoder.garbage, decoder.lost, decoder.unknown) == (0, 0, 0, 0)
        assert decoder.unbalanced == decoder.mismatched == 0

    def assert_frames_are_the_model_s(self, since=0):
        """Every pattern frame that came, from this number on, against the model of what was shown.

        Frames may be missing at the end, on their way.
        """
        limit = self.commands.read("points_max")
        model = Model(self.settings, self.config.width, self.config.height, limit)
        frames = {frame.index: frame for frame in self.frames}
        last = max(frames)
        for number, (image, integrated_us, lit_us) in enumerate(
                self.shown[since:last + 1], since):
            if image is None:
                assert number not in frames and lit_us == 0
                continue
            frame = frames[number]
            assert same(frame, model.frame(image)), f"frame {number}"
            assert frame.exposure_us == round(integrated_us) and frame.laser == (lit_us > 0)

    def assert_light_is_safe(self):
        """All pulses within the guard's ceilings, as the laser driver saw them; how many."""
        pulses = self.instrument.pulses * 1e6 / self.config.clock_hz
        if len(pulses):
            pulses[pulses[:, 1] == 0, 1] = self.now_us
            lengths = pulses[:, 1] - pulses[:, 0]
            assert lengths.max() <= PULSE_US + HOLD_US
            assert len(pulses) == 1 or np.diff(pulses[:, 0]).min() >= REPETITION_US
            for end in pulses[:, 1]:
                start = np.clip(pulses[:, 0], end - WINDOW_US, end)
                on = np.clip(pulses[:, 1], end - WINDOW_US, end) - start
                assert on.sum() <= WINDOW_ON_US + 3 * HOLD_US
        return len(pulses)
