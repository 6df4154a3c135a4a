"""The top for a board, in Verilog: clocks, resets, and the laser's register in its I/O cell."""

from textwrap import indent

__all__ = ["CORE", "LASER", "board_pins", "board_top", "reset_registers"]

#: Instance of the design in the top.
CORE = "core"
#: Register of the laser's pin in the top.
LASER = "laser_pin"

_CLOCKS = {
    "dcm": """\
wire feedback, feedback_raw, twice_raw, twice, display_raw, locked;
DCM #(
  .CLKIN_PERIOD(10.0), .CLK_FEEDBACK("1X"), .CLKDV_DIVIDE(4.0),
  .CLKFX_MULTIPLY(8), .CLKFX_DIVIDE(25), .DLL_FREQUENCY_MODE("LOW"), .DFS_FREQUENCY_MODE("LOW")
) dcm (
  .CLKIN(oscillator), .CLKFB(feedback), .RST(1'b0), .PSEN(1'b0), .PSINCDEC(1'b0), .PSCLK(1'b0),
  .DSSEN(1'b0), .CLK0(feedback_raw), .CLKFX(twice_raw), .CLKDV(display_raw), .LOCKED(locked),
  .CLK90(), .CLK180(), .CLK270(), .CLK2X(), .CLK2X180(), .CLKFX180(), .STATUS(), .PSDONE());
wire oscillator;
IBUFG oscillator_buffer(.I(clock_in), .O(oscillator));
BUFG feedback_buffer(.I(feedback_raw), .O(feedback));
BUFG twice_buffer(.I(twice_raw), .O(twice));
reg half = 1'b0;  // 32 MHz, the least that the DCM makes, becomes 16 MHz
always @(posedge twice) half <= ~half;
BUFG clk_buffer(.I(half), .O(clk));
BUFG pixel_buffer(.I(pixel_clk), .O(pixel_clock));
{display}""",
    "mmcm": """\
wire feedback, clk_raw, display_raw, locked;
MMCME2_BASE #(
  .CLKIN1_PERIOD({period:.3f}), .DIVCLK_DIVIDE(1), .CLKFBOUT_MULT_F({multiplier:.3f}),
  .CLKOUT0_DIVIDE_F(50.000), .CLKOUT1_DIVIDE(32)
) mmcm (
  .CLKIN1(clock_in), .CLKFBIN(feedback), .CLKFBOUT(feedback), .RST(1'b0), .PWRDWN(1'b0),
  .CLKOUT0(clk_raw), .CLKOUT1(display_raw), .LOCKED(locked), .CLKFBOUTB(), .CLKOUT0B(),
  .CLKOUT1B(), .CLKOUT2(), .CLKOUT2B(), .CLKOUT3(), .CLKOUT3B(), .CLKOUT4(), .CLKOUT5(),
  .CLKOUT6());
BUFG clk_buffer(.I(clk_raw), .O(clk));
BUFG pixel_buffer(.I(pixel_clk), .O(pixel_clock));
{display}""",
    "pll": """\
wire feedback, locked;
(* FREQUENCY_PIN_CLKI = "25", FREQUENCY_PIN_CLKOP = "80", FREQUENCY_PIN_CLKOS = "16" *)
EHXPLLL #(
  .PLLRST_ENA("DISABLED"), .INTFB_WAKE("DISABLED"), .STDBY_ENABLE("DISABLED"),
  .DPHASE_SOURCE("DISABLED"), .OUTDIVIDER_MUXA("DIVA"), .OUTDIVIDER_MUXB("DIVB"),
  .OUTDIVIDER_MUXC("DIVC"), .OUTDIVIDER_MUXD("DIVD"), .FEEDBK_PATH("CLKOP"),
  .CLKI_DIV(5), .CLKFB_DIV(16), .CLKOP_ENABLE("ENABLED"), .CLKOP_DIV(7), .CLKOP_CPHASE(3),
  .CLKOP_FPHASE(0), .CLKOS_ENABLE("ENABLED"), .CLKOS_DIV(35), .CLKOS_CPHASE(3),
  .CLKOS_FPHASE(0)
) pll (
  .CLKI(clock_in), .CLKFB(feedback), .CLKOP(feedback), .CLKOS(clk), .LOCK(locked), .RST(1'b0),
  .STDBY(1'b0), .PHASESEL0(1'b0), .PHASESEL1(1'b0), .PHASEDIR(1'b1), .PHASESTEP(1'b1),
  .PHASELOADREG(1'b1), .PLLWAKESYNC(1'b0), .ENCLKOP(1'b0));
assign pixel_clock = pixel_clk;
{display}""",
    "divide": """\
wire locked = 1'b1;
reg [2:0] phase = 3'd0;
reg divided = 1'b0, display_half = 1'b0;
always @(posedge clock_in or posedge reset) begin
  if (reset) begin
    phase <= 3'd0;
    divided <= 1'b0;
    display_half <= 1'b0;
  end else begin
    phase <= phase == 3'd4 ? 3'd0 : phase + 3'd1;
    divided <= phase < 3'd2;
    display_half <= ~display_half;
  end
end
CLKINT clk_buffer(.A(divided), .Y(clk));
CLKINT pixel_buffer(.A(pixel_clk), .Y(pixel_clock));
{display}""",
}
_DISPLAY = {
    "dcm": "BUFG display_buffer(.I(display_raw), .O(display_clk));",
    "mmcm": "BUFG display_buffer(.I(display_raw), .O(display_clk));",
    "pll": "assign display_clk = clock_in;",
    "divide": "CLKINT display_buffer(.A(display_half), .Y(display_clk));",
}
_HOLDS = "ASYNC_REG = \"TRUE\", SHREG_EXTRACT = \"NO\", keep = \"true\", syn_preserve = 1"


def reset_registers(timing):
    """Clocks of the design and the registers of the top that release their resets."""
    return {clock: f"reset_{clock}" for clock in timing.clocks}


def board_pins(ports, timing):
    """Pins of the board's top: name to direction and width; ``ports`` are those of the design."""
    internal = {"clk", "rst", "pixel_rst", "display_clk", "display_rst"}
    pins = {"clock_in": ("input", 1), "reset_in": ("input", 1)}
    for port in ports:
        if port.name == "pins_data_in":
            pins["pins_data"] = ("inout", port.width)
        elif port.name not in internal and not port.name.startswith("pins_data_"):
            pins[port.name] = (port.direction, port.width)
    return pins


def _laser(board, reset):
    """The laser's register, which the ECP5 has as a cell of its own."""
    if board.clocks == "pll":
        return (f"wire {LASER};\nOFS1P3DX {LASER}_cell(.D(light), .SP(1'b1), .SCLK(clk), "
                f".CD({reset}[1]), .Q({LASER}));")
    return (f'(* IOB = "TRUE", syn_useioff = 1 *)\nreg {LASER} = 1\'b0;\n'
            f"always @(posedge clk)\n  if ({reset}[1]) {LASER} <= 1'b0;\n"
            f"  else {LASER} <= light;")


def _display(board, timing):
    if "display_clk" in timing.clocks:
        return _DISPLAY[board.clocks]
    return ""


def board_top(board, ports, timing, name):
    """Verilog of the top for ``board``, as the module of the board's name."""
    pins = board_pins(ports, timing)
    resets = reset_registers(timing)
    vector = {1: ""}
    header = ",\n".join(
        f"  {direction} {vector.get(width, f'[{width - 1}:0] ')}{pin}"
        for pin, (direction, width) in pins.items())
    clocks = _CLOCKS[board.clocks].format(
        display=_display(board, timing), period=1e9 / board.oscillator_hz,
        multiplier=800e6 / board.oscillator_hz)
    # The oscillator's buffer is declared before it is used.
    lines = clocks.split("\n")
    first = [line for line in lines if line.startswith(("wire", "IBUFG"))]
    clocks = "\n".join([*first, *(line for line in lines if line not in first)]).rstrip()
    if "display_clk" not in timing.clocks:
        clocks = clocks.replace(", display_raw", "").replace(".CLKDV(display_raw)", ".CLKDV()") \
            .replace(".CLKOUT1(display_raw)", ".CLKOUT1()").replace(", display_half = 1'b0", "") \
            .replace("    display_half <= 1'b0;\n", "").replace(
                "    display_half <= ~display_half;\n", "")
    nets = [f"wire {clock};" for clock in timing.clocks if clock != "pixel_clk"]
    nets += ["wire pixel_clock;"] if "pixel_clk" in timing.clocks else []
    if "pixel_clk" not in timing.clocks:
        clocks = "\n".join(line for line in clocks.split("\n") if "pixel" not in line)
    release = "\n".join(
        f"""(* {_HOLDS} *)
reg [1:0] {register} = 2'b11;
always @(posedge {net} or posedge stop)
  if (stop) {register} <= 2'b11;
  else {register} <= {{{register}[0], 1'b0}};"""
        for clock, register in resets.items()
        for net in ["pixel_clock" if clock == "pixel_clk" else clock])
    wires, connections = [], []
    for port in ports:
        value = port.name
        if port.name.endswith("rst"):
            clock = "clk" if port.name == "rst" else port.name.replace("rst", "clk")
            value = f"{resets[clock]}[1]"
        elif port.name == "pixel_clk":
            value = "pixel_clock"
        elif port.name == "laser":
            value = "light"
        elif port.name == "pins_data_in":
            value = "pins_data"
        elif port.name in ("pins_data_out", "pins_data_drive"):
            wires.append(f"wire {vector.get(port.width, f'[{port.width - 1}:0] ')}{port.name};")
        connections.append(f"  .{port.name}({value})")
    if "pins_data" in pins:
        wires.append(f"assign pins_data = pins_data_drive ? pins_data_out : "
                     f"{{{pins['pins_data'][1]}{{1'bz}}}};")
    body = "\n".join([
        f"wire reset = {'~' if board.reset_low else ''}reset_in;", *nets, clocks,
        "// Resets begin at once and end with their own clock.",
        "wire stop = reset | ~locked;", release, "wire light;",
        "// A clock behind the guard, without logic before the pin; low in reset.",
        _laser(board, resets["clk"]), f"assign laser = {LASER};", *wires,
        f"{name} {CORE} (\n" + ",\n".join(connections) + "\n);"])
    about = board.title or f"a board with the {board.part}"
    return (f"// The design on {about}: oscillator of {board.oscillator_hz / 1e6:g} MHz at "
            f"clock_in,\n// reset at reset_in, active {'low' if board.reset_low else 'high'}.\n"
            f"module {board.name}(\n{header}\n);\n{indent(body, '  ')}\nendmodule\n")
