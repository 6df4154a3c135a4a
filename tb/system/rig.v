// For simulation only: a sensor that plays stored frames, the capsule, and the reader's end of the
// serial line. The clock runs in here, so that a bench wakes only for octets and whole frames.
`timescale 1ns / 1ps

module rig #(
    parameter WIDTH = 352,
    parameter HEIGHT = 288,
    parameter FRAMES = 32
);

    // The same clock for pixels and system: one pixel a clock. With GATED, the spot side's stands
    // still while it is not busy.
    reg clk = 0;
    reg spot_clk = 0;
    reg rst = 1;
    wire busy;
    always begin
        #5 clk = 1;
        spot_clk = busy;
        #5 clk = 0;
        spot_clk = 0;
    end

    // Sensor. `frames` frames are shown from `first` on once `start` rises; then `done` is high.
    // In frame `faulty`, line `fault_row` has `fault_extra` pixels too many, or too few if
    // negative; `fault_lines` lines are missing at its end.
    reg [7:0] pixels [0:FRAMES*WIDTH*HEIGHT-1];
    reg start = 0;
    reg done = 0;
    reg [15:0] first = 0;
    reg [15:0] frames = 0;
    reg [15:0] line_blanking = 0;
    reg [15:0] frame_blanking = 16;
    reg [15:0] faulty = 16'hffff;
    reg [15:0] fault_row = 0;
    reg signed [15:0] fault_extra = 0;
    reg [15:0] fault_lines = 0;

    reg frame_valid = 0;
    reg line_valid = 0;
    reg [7:0] data = 0;
    reg started = 0;
    reg running = 0;
    integer frame = 0;
    integer row = 0;
    integer column = 0;  // beyond the line's length: blanking
    integer address = 0;
    integer length;
    integer rows;
    reg [1023:0] file;

    initial if ($value$plusargs("pixels=%s", file) != 0) $readmemh(file, pixels);

    always @(*) begin
        length = WIDTH;
        rows = HEIGHT;
        if (frame == 32'(faulty)) begin
            rows = HEIGHT - 32'(fault_lines);
            if (row == 32'(fault_row)) length = WIDTH + 32'(fault_extra);
        end
    end

    always @(posedge clk) begin
        started <= start;
        frame_valid <= 0;
        line_valid <= 0;
        if (!running) begin
            if (start && !started) begin
                running <= 1;
                done <= 0;
                frame <= 32'(first);
                row <= 0;
                column <= 0;
                address <= 32'(first) * WIDTH * HEIGHT;
            end
        end else if (row < rows) begin
            frame_valid <= 1;
            line_valid <= column < length;
            data <= pixels[address];
            if (column < length && column < WIDTH) address <= address + 1;
            column <= column + 1;
            if (column == length + 32'(line_blanking) - 1) begin
                column <= 0;
                row <= row + 1;
            end
        end else begin
            column <= column + 1;
            if (column >= 32'(frame_blanking)) begin
                column <= 0;
                row <= 0;
                frame <= frame + 1;
                address <= (frame + 1) * WIDTH * HEIGHT;
                if (frame + 1 == 32'(first) + 32'(frames)) begin
                    running <= 0;
                    done <= 1;
                end
            end
        end
    end

    // Registers and tables, driven by the bench. frames.py defines `REGISTERS, which declares every
    // register of the capsule, and `REGISTER_PORTS, which connects them.
    `REGISTERS
    reg bank = 0;
    reg table_write = 0;
    reg [1:0] table_select = 0;
    reg [9:0] table_address = 0;
    reg [71:0] table_data = 0;
    wire tx;

    // The sequencer's signals and the counters are not looked at here.
    /* verilator lint_off PINMISSING */
    capsule capsule (
        .clk(clk), .rst(rst), .pixel_clk(clk), .pixel_rst(rst), .busy(busy),
`ifdef GATED
        .spot_clk(spot_clk), .spot_rst(rst),
`endif
        .frame_valid(frame_valid), .line_valid(line_valid), .data(data), .tx(tx),
        `REGISTER_PORTS,
        .cts(1'b1), .wake(1'b0), .tag(0), .tripped(1'b0), .tables_valid(1'b1),
        .reply_valid(1'b0), .reply_payload(0),
        .table_write(table_write), .table_read(1'b0), .bank(bank),
        .table_select(table_select),
        .table_address(table_address), .table_data(table_data)
    );

    // Serial receiver, 8N1: `octet` is new whenever `octets` changes.
    reg [7:0] octet = 0;
    reg [31:0] octets = 0;
    reg framing_error = 0;
    reg [7:0] shift = 0;
    reg [15:0] left = 0;  // clocks until the line is looked at
    reg [3:0] bits = 0;  // so many still to come, the stop bit included

    always @(posedge clk) begin
        if (bits == 0) begin
            if (!rst && !tx) begin
                // From somewhere in the start bit's first clock to the middle of the first bit.
                bits <= 9;
                left <= divisor + divisor / 2 - 1;
            end
        end else if (left != 0) begin
            left <= left - 1;
        end else begin
            bits <= bits - 1;
            left <= divisor - 1;
            if (bits != 1) begin
                shift <= {tx, shift[7:1]};
            end else begin
                framing_error <= framing_error | !tx;
                octet <= shift;
                octets <= octets + 1;
            end
        end
    end

endmodule
