"""A folder with all that is received, from the first octet on."""

import shlex
from contextlib import suppress

from model.errors import UserError
from scripts.host.decoder import Decoder
from scripts.host.link_file import LinkFile
from scripts.host.rebuild import Rebuilder
from scripts.host.recorder import Recorder
from scripts.results.outputs import take_folder

__all__ = ["Reception"]


class Reception:
    """Records octets, then decodes them, and writes what they contain.

    Everything has its name from the start. ``link.raw`` holds each chunk before anything is made
    of it, and the tables follow with the chunk, in whole rows: whatever ends the program, what came
    is there, and the recording can be replayed.

    Parameters
    ----------
    path : path
        Folder to create, or an empty one.
    calibration : :class:`calibration.file.Calibration` or None
        What the chip was loaded with.
    live : :class:`bool`
        The octets are nowhere else.
    clouds
        What :class:`scripts.host.recorder.Recorder` has to know of the point clouds.

    Attributes
    ----------
    decoder : :class:`scripts.host.decoder.Decoder`
        What the octets went through.
    recorder : :class:`scripts.host.recorder.Recorder`
        What was made of them.
    """

    def __init__(self, path, calibration=None, live=True, **clouds):
        rebuild = calibration and Rebuilder(
            calibration.settings, calibration.width, calibration.height)
        self._live = live
        self.decoder = Decoder(rebuild)
        self.folder, self._created = take_folder(path)
        self._link = self.recorder = None
        try:
            self._link = LinkFile(self.folder / "link.raw", sync=live)
            self.recorder = Recorder(self.folder, calibration, **clouds)
        except BaseException:
            self._remove()
            raise

    def take(self, octets, ended=None):
        """Record octets and what they contain.

        Parameters
        ----------
        octets : :class:`bytes`
            What came.
        ended : callable or None
            Given the events of each packet: whether it is the last one to be recorded.

        Returns
        -------
        bool
            ``ended`` was true; what came behind that packet is not recorded.
        """
        begin = self._link.size
        self._link.write(octets)
        try:
            for end, events in self.decoder.packets_of(octets):
                for event in events:
                    self.recorder.take(event)
                if ended is not None and ended(events):
                    self._link.truncate(begin + end)
                    return True
        finally:
            self.recorder.flush()
        return False

    def finish(self):
        """Complete all files."""
        self._link.close()
        for event in self.decoder.finish():
            self.recorder.take(event)
        self.recorder.finish()
        self.recorder.close()

    def abandon(self, calibration_path=None):
        """Close all files after a failure, and keep what is nowhere else.

        Returns
        -------
        :class:`str`
            What was kept, and how to get the rest; nothing if nothing was.
        """
        for part in (self._link, self.recorder):
            with suppress(UserError, OSError):
                part.close()
        if not (self._live and self.decoder.packets):
            self._remove()
            return ""
        words = ["cyclope", "receive", self._link.path, "-o", "OTHER"]
        if calibration_path is not None:
            words += ["--calibration", calibration_path]
        elif self.recorder.last is not None and self.recorder.last.compact:
            words += ["--calibration", "FILE"]
        return (f"{self._link.path} keeps all {self._link.size} octets that came until then, and "
                f"the tables beside it what was made of them: `{shlex.join(map(str, words))}` "
                "does it again.")

    def _remove(self):
        """Remove what this created."""
        written = self.recorder.written if self.recorder is not None else set()
        for path in sorted(written, reverse=True):
            with suppress(OSError):
                path.rmdir() if path.is_dir() else path.unlink()
        if self._link is not None:
            self._link.close()
            with suppress(OSError):
                self._link.path.unlink()
        if self._created:
            with suppress(OSError):
                self.folder.rmdir()
