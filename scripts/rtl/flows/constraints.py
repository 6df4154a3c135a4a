"""The constraints of a design on a board, in the words of each vendor.

All of them come from a :class:`scripts.rtl.timing.Timing`: every clock, every pin, every crossing.
A pin's delay outside the chip is taken to be half a clock, but a quarter for what drives the
external memory, which works in steps of half a clock.
"""

from scripts.rtl.flows.board_top import CORE, LASER, board_pins, reset_registers

__all__ = ["lpf", "pdc", "sdc", "ucf", "xdc"]

_HEAD = "Generated from the design and its table of clock crossings; times are in nanoseconds."
_PLACE = "has no site here: choose one for your wiring, take the # away"


def _net(clock):
    """The net of a clock in the board's top."""
    return "pixel_clock" if clock == "pixel_clk" else clock


def _delays(timing):
    """Pins with their clock, their direction, and the delay outside, in nanoseconds."""
    for direction, pins in (("input", timing.inputs), ("output", timing.outputs)):
        for clock, names in pins.items():
            for name in names if clock else ():
                memory = direction == "output" and name.startswith("pins_")
                pin = "pins_data" if name.startswith("pins_data_") else name
                yield pin, clock, direction, timing.clocks[clock] / (4 if memory else 2)


def _loose_pins(timing):
    """Pins that belong to no clock."""
    return timing.inputs.get(None, ()) + timing.outputs.get(None, ())


def _sites(board, ports, timing, comment="  # "):
    """For each bit of each pin its name, its site, a mark before a line that is none yet, and what
    is said behind it."""
    for pin, (_, width) in board_pins(ports, timing).items():
        mark = "" if pin in board.pins else "# "
        site = board.pins.get(pin, board.unsure.get(pin))
        for bit in range(width):
            name = pin if width == 1 else f"{pin}[{bit}]"
            where = site[bit] if isinstance(site, list) else site
            yield name, where or "SITE", mark, "" if where else f"{comment}{name} {_PLACE}"


def _is_vector(ports, timing, pin):
    return board_pins(ports, timing)[pin][1] > 1


# Tcl of Vivado and Libero ---------------------------------------------------------------------

def _tcl_port(ports, timing, pin):
    return f"[get_ports {{{pin}{'[*]' if _is_vector(ports, timing, pin) else ''}}}]"


def _tcl_loose_pins(timing):
    return [f"set_false_path {'-from' if pin in timing.inputs.get(None, ()) else '-to'} "
            f"[get_ports {{{pin}}}]" for pin in _loose_pins(timing)]


def _tcl_crossings(timing, suffix, bounded):
    """Limits between clocks, and those of single crossings.

    ``suffix`` stands behind the names of registers; ``bounded`` makes a command of nanoseconds and
    two ends.
    """
    def cells(named):
        return "[get_cells {" + " ".join(
            f"{CORE}/{name.replace('.', '/')}{suffix}{'[*]' if width > 1 else ''}"
            for name, width in named) + "}]"

    lines = ["", "# Between clocks: bounded wherever no line below says otherwise"]
    lines += [bounded(ns, f"[get_clocks {{{a}}}]", f"[get_clocks {{{b}}}]")
              for (a, b), ns in timing.bounds.items()]
    for number, one in enumerate(timing.exceptions, 1):
        lines += ["", f"# Crossing {number}: {one.title}"]
        if not one.destinations:
            lines.append("#   memory: the bound between both clocks")
            continue
        if one.pin and one.pin.endswith("rst"):
            register = reset_registers(timing)[one.pin.replace("rst", "clk")]
            source = f"[get_cells {{{register}{suffix}[1]}}]"
        elif one.pin:
            source = f"[get_ports {{{one.pin}}}]"
        else:
            source = cells(one.sources)
        to = cells(one.destinations)
        lines.append(f"set_false_path -from {source} -to {to}" if one.ns is None
                     else bounded(one.ns, source, to))
    return lines


# Vivado ---------------------------------------------------------------------------------------

def xdc(board, ports, timing):
    """Constraints for Vivado."""
    lines = [f"# {_HEAD}", "", "# Clocks",
             f"create_clock -name oscillator -period {1e9 / board.oscillator_hz:.3f} "
             "[get_ports {clock_in}]"]
    outputs = {"clk": "mmcm/CLKOUT0", "display_clk": "mmcm/CLKOUT1"}
    for clock, period in timing.clocks.items():
        if clock in outputs:
            lines.append(f"create_generated_clock -name {clock} [get_pins {{{outputs[clock]}}}]")
        else:
            lines.append(f"create_clock -name {clock} -period {period:.3f} [get_ports {{{clock}}}]")
    lines += ["", "# Pins"]
    for pin, clock, direction, ns in _delays(timing):
        lines += [f"set_{direction}_delay -clock [get_clocks {{{clock}}}] -{limit} {value:.3f} "
                  f"-add_delay {_tcl_port(ports, timing, pin)}"
                  for limit, value in (("max", ns), ("min", 0))]
    lines += _tcl_loose_pins(timing)
    lines += ["", "# Resets begin at any time; the last flip-flop of each ends in step.",
              "set_false_path -from [get_ports {reset_in}]"]
    lines += [f"set_false_path -through [get_pins {{{register}_reg[*]/PRE}}]"
              for register in reset_registers(timing).values()]
    lines += _tcl_crossings(timing, "_reg", lambda ns, source, to: (
        f"set_max_delay -datapath_only -from {source} -to {to} {ns:.3f}"))
    settling = " ".join(f"{CORE}/{name.replace('.', '/')}_reg*" for name in timing.synchronisers)
    lines += ["", "# Synchronisers stay pairs of flip-flops, side by side",
              f"set_property ASYNC_REG TRUE [get_cells {{{settling}}}]",
              f"set_property SHREG_EXTRACT NO [get_cells {{{settling}}}]",
              "", "# The laser guard keeps registers that are equal unless a bit has flipped",
              f"set_property DONT_TOUCH TRUE [get_cells {{{CORE}/laser_guard}}]",
              "", "# The laser's register stands in its I/O cell",
              f"set_property IOB TRUE [get_cells {{{LASER}_reg}}]", "", "# Sites"]
    for pin, site, mark, note in _sites(board, ports, timing, "  ;# "):
        lines.append(f"{mark}set_property PACKAGE_PIN {site} [get_ports {{{pin}}}]{note}")
    lines.append(f"set_property IOSTANDARD {board.standard} [get_ports *]")
    return "\n".join([*lines, ""])


# ISE ------------------------------------------------------------------------------------------

def _ucf_group(group, named):
    return [f'INST "{CORE}/{name.replace(".", "/")}{"_*" if width > 1 else ""}" TNM = "{group}";'
            for name, width in named]


def ucf(board, ports, timing):
    """Constraints for ISE 10.1."""
    lines = [f"# {_HEAD}", "", "# Clocks",
             'NET "clock_in" TNM_NET = "oscillator";',
             f'TIMESPEC "TS_oscillator" = PERIOD "oscillator" {1e9 / board.oscillator_hz:.3f} ns '
             'HIGH 50%;']
    for clock, period in timing.clocks.items():
        lines += [f'NET "{_net(clock)}" TNM_NET = "{clock}";',
                  f'TIMESPEC "TS_{clock}" = PERIOD "{clock}" {period:.3f} ns HIGH 50%;']
    lines += ["", "# Pins"]
    for pin, clock, direction, ns in _delays(timing):
        pad = f'{pin}<*>' if _is_vector(ports, timing, pin) else pin
        group = f"pads_{direction}_{clock}_{'memory' if pin.startswith('pins_') else 'other'}"
        lines.append(f'NET "{pad}" TNM = "{group}";')
        path = (f'FROM "{group}" TO "{clock}"' if direction == "input"
                else f'FROM "{clock}" TO "{group}"')
        spec = (f'TIMESPEC "TS_{group}" = {path} {timing.clocks[clock] - ns:.3f} ns;')
        if spec not in lines:
            lines.append(spec)
    lines += [f'NET "{pin}" TIG;' for pin in _loose_pins(timing)]
    lines += ["", "# Resets begin at any time.", 'NET "reset_in" TIG;', 'NET "stop" TIG;']
    lines += ["", "# Between clocks: bounded wherever no line below says otherwise"]
    lines += [f'TIMESPEC "TS_{a}_to_{b}" = FROM "{a}" TO "{b}" {ns:.3f} ns;'
              for (a, b), ns in timing.bounds.items()]
    for number, one in enumerate(timing.exceptions, 1):
        lines += ["", f"# Crossing {number}: {one.title}"]
        if not one.destinations:
            lines.append("#   memory: the bound between both clocks")
            continue
        lines += _ucf_group(f"to_{number}", one.destinations)
        source = f"from_{number}"
        if one.pin and one.pin.endswith("rst"):
            register = reset_registers(timing)[one.pin.replace("rst", "clk")]
            lines.append(f'INST "{register}_*" TNM = "{source}";')
        elif one.pin:
            lines.append(f'NET "{one.pin}" TNM = "{source}";')
        else:
            lines += _ucf_group(source, one.sources)
        limit = "TIG" if one.ns is None else f"{one.ns:.3f} ns"
        lines.append(f'TIMESPEC "TS_{number}" = FROM "{source}" TO "to_{number}" {limit};')
    lines += ["", "# The laser's register stands in its I/O cell",
              f'INST "{LASER}" IOB = TRUE;', "", "# Sites"]
    for pin, site, mark, note in _sites(board, ports, timing):
        pad = pin.replace("[", "<").replace("]", ">")
        lines.append(f'{mark}NET "{pad}" LOC = "{site}" | IOSTANDARD = '
                     f'"{board.standard}";{note}')
    return "\n".join([*lines, ""])


# Libero ---------------------------------------------------------------------------------------

def sdc(board, ports, timing):
    """Timing constraints for Libero: Synplify and SmartTime."""
    lines = [f"# {_HEAD}", "", "# Clocks",
             f"create_clock -name {{oscillator}} -period {1e9 / board.oscillator_hz:.3f} "
             "[get_ports {clock_in}]"]
    sources = {"clk": ("divided", 5), "display_clk": ("display_half", 2)}
    for clock, period in timing.clocks.items():
        if clock in sources:
            register, factor = sources[clock]
            lines.append(f"create_generated_clock -name {{{clock}}} -divide_by {factor} -source "
                         f"[get_ports {{clock_in}}] [get_pins {{{register}/Q}}]")
        else:
            lines.append(f"create_clock -name {{{clock}}} -period {period:.3f} "
                         f"[get_ports {{{clock}}}]")
    lines += ["", "# Pins"]
    for pin, clock, direction, ns in _delays(timing):
        lines += [f"set_{direction}_delay -{limit} {value:.3f} -clock {{{clock}}} "
                  f"{_tcl_port(ports, timing, pin)}" for limit, value in (("max", ns), ("min", 0))]
    lines += _tcl_loose_pins(timing)
    lines += ["", "# Resets begin at any time.", "set_false_path -from [get_ports {reset_in}]"]
    lines += _tcl_crossings(timing, "", lambda ns, source, to: (
        f"set_max_delay {ns:.3f} -from {source} -to {to}"))
    return "\n".join([*lines, ""])


def pdc(board, ports, timing):
    """Sites of pins for Libero."""
    lines = [f"# {_HEAD}", "# Sites that are comments are not sure: compare them with your board's "
             "schematic."]
    flash = board.device["family"] == "ProASIC3E"
    for pin, site, mark, note in _sites(board, ports, timing, "  ;# "):
        lines.append(f"{mark}set_io {{{pin}}} -pinname {site} -fixed yes "
                     f"-iostd {board.standard}{note}")
    lines += ["", "# The laser's register stands in its I/O cell"]
    lines += ["set_io {laser} -register yes"] if flash else [
        f"# {board.name}.ndc says so"]
    return "\n".join([*lines, ""])


# Lattice --------------------------------------------------------------------------------------

def lpf(board, ports, timing):
    """Constraints for nextpnr; ``check_timing.py`` holds the crossings against the report."""
    lines = [f"# {_HEAD}", "", "# Clocks",
             f'FREQUENCY PORT "clock_in" {board.oscillator_hz / 1e6:g} MHZ;']
    for clock, period in timing.clocks.items():
        if clock == "pixel_clk":
            lines.append(f'FREQUENCY PORT "{clock}" {1e3 / period:.3f} MHZ;')
        elif clock != "display_clk":
            lines.append(f'FREQUENCY NET "{clock}" {1e3 / period:.3f} MHZ;')
    lines += ["", "# Between clocks: nextpnr takes no constraint, so check_timing.py compares the "
              "longest", "# delay of each pair of clocks in its report with the bound."]
    lines += [f"# {a} -> {b}: {ns:.3f}" for (a, b), ns in timing.bounds.items()]
    for number, one in enumerate(timing.exceptions, 1):
        limit = "any time" if one.ns is None else f"{one.ns:.3f}"
        lines.append(f"# Crossing {number}: {one.title}: {limit}")
    lines += ["", "# Sites"]
    for pin, site, mark, note in _sites(board, ports, timing):
        lines += [f'{mark}LOCATE COMP "{pin}" SITE "{site}";{note}',
                  f'IOBUF PORT "{pin}" IO_TYPE={board.standard};']
    return "\n".join([*lines, ""])
