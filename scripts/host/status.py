"""The state of the chip in words."""

from hdl.protocol import DISPLAY_FAULTS, GUARD_CAUSES, PRESET_NAMES, STATUS_FIELDS, Mode

__all__ = ["HEARTBEAT", "causes", "find_faults", "laser", "status_table"]

_MODES = {Mode.STOP: "stopped", Mode.CONTINUOUS: "continuous", Mode.SINGLE: "single pair",
          Mode.PATTERN: "pattern only"}
_CAUSES = {
    "pulse": "a pulse longer than the ceiling", "repetition": "a pulse too soon after another",
    "duty": "too much light in the window", "not_armed": "light requested while not armed",
    "heartbeat": "frames that stopped coming", "upset": "a flipped bit in its registers"}
HEARTBEAT = 1 << GUARD_CAUSES.index("heartbeat")
_FAULTS = {
    "frame": "the end of a frame was lost", "row": "a row arrived too late",
    "overlay": "a spot was not drawn"}


def causes(status):
    """Causes that the laser guard holds, in words."""
    return [_CAUSES.get(name, name) for bit, name in enumerate(GUARD_CAUSES)
            if status["guard_causes"] >> bit & 1]


def find_faults(status):
    """Why what the chip sends is not to be used, in a list of sentences.

    A chip that stands still is not at fault; that no frames came since it was stopped is noted by
    its laser guard, and means nothing then.
    """
    state = status["state"]
    faults = []
    if state.mode == Mode.STOP:
        status = {**status, "guard_causes": status["guard_causes"] & ~HEARTBEAT}
    elif state.silent:
        faults.append("the sensor is silent: no frame comes from it.")
    held = causes(status)
    if held:
        faults.append(f"the laser guard has tripped: it saw {', '.join(held)}; when the reason is "
                      "gone, `cyclope load PORT --clear` forgets it.")
    if state.mode != Mode.STOP and not state.armed:
        faults.append("the laser stays off: " + (
            "its guard waits for frames." if state.tables_valid or state.capture else
            "there are no valid tables, which `cyclope load PORT calibration.json` loads."))
    return faults


def laser(status):
    """State of the laser, in words."""
    state = status["state"]
    held = causes(status)
    words = "armed" if state.armed else "disarmed"
    if state.capture:
        words += " by the calibration capture"
    elif not state.tables_valid:
        words += ": there are no valid tables"
    return words + (f"; the guard saw {', '.join(held)}" if held else "")


def status_table(identity, status, pattern_as_texture=0):
    """A table of what the chip is and does."""
    from rich import box
    from rich.table import Table
    state = status["state"]
    table = Table(box=box.SIMPLE, show_header=False, padding=(0, 1), pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column(style="dim")
    preset = identity["preset"]
    table.add_row("sensor", f"{identity['width']} x {identity['height']}", "pixels")
    table.add_row("beams", str(identity["beams"]), f"{identity['lanes']} lines tried at a time")
    table.add_row("preset", PRESET_NAMES[preset] if preset < len(PRESET_NAMES) else str(preset),
                  f"system clock {identity['clock_khz'] / 1000:g} MHz")
    table.add_section()
    as_images = pattern_as_texture and state.mode == Mode.PATTERN
    table.add_row("mode", _MODES[state.mode] + (", as images" if as_images else ""),
                  "the sensor is silent" if state.silent else "")
    table.add_row("tables", "valid" if state.tables_valid else "none", f"bank {state.bank}" + (
        ", a new set waits for its frame" if state.committing else ""))
    table.add_row("laser", "armed" if state.armed else "disarmed", "; ".join(
        [*(["calibration capture"] if state.capture else []), *causes(status)]))
    table.add_section()
    for field in STATUS_FIELDS:
        if field.name not in ("state", "guard_causes", "display"):
            table.add_row(field.name.replace("_", " "), str(status[field.name]), field.meaning)
    if preset == PRESET_NAMES.index("paper"):
        faults = [_FAULTS[name] for bit, name in enumerate(DISPLAY_FAULTS)
                  if status["display"] >> bit & 1]
        table.add_row("display", "faults" if faults else "ok", "; ".join(faults))
    return table
