// For simulation only: a camera, the frame store, the screen's pins, and what records them. The
// clocks run in here; a bench sets the rig up, waits, and reads the recording.
`timescale 1ns / 1ps

module screen_rig #(
    parameter WIDTH = 64,
    parameter HEIGHT = 64,
    parameter IMAGES = 8,
    parameter LISTS = 8,
    parameter LENGTH = 160,
    parameter COLOUR = 8
);
    localparam PIXELS = WIDTH * HEIGHT;
    localparam SCREEN = 800 * 525;

    reg [31:0] sync_ps = 62500;
    reg [31:0] display_ps = 39722;
    reg clk = 0;
    reg display_clk = 0;
    reg rst = 1;
    reg running = 0;
    always @(posedge running) while (running) begin
        #(sync_ps / 2000.0) clk = 1;
        #(sync_ps / 2000.0) clk = 0;
    end
    always @(posedge running) while (running) begin
        #(display_ps / 2000.0) display_clk = 1;
        #(display_ps / 2000.0) display_clk = 0;
    end

    // Images, and lists of spots, each with its end; number n is in slot n % IMAGES or n % LISTS.
    reg [7:0] pixels [0:IMAGES*PIXELS-1];
    reg [37:0] spots [0:LISTS*LENGTH-1];
    reg [1023:0] path;
    integer record;
    integer log;
    initial begin
        if ($value$plusargs("pixels=%s", path) != 0) $readmemh(path, pixels);
        if ($value$plusargs("spots=%s", path) != 0) $readmemh(path, spots);
        if ($value$plusargs("record=%s", path) != 0) record = $fopen(path, "wb");
        if ($value$plusargs("log=%s", path) != 0) log = $fopen(path, "w");
    end

    // Camera: a pixel every `period` clocks, `blanking` clocks after each frame. Every other frame
    // is a texture frame if `pairs`. The list of a pattern frame comes `delay` clocks after it.
    reg [15:0] period = 2;
    reg [31:0] blanking = 1000;
    reg [31:0] delay = 100;
    reg pairs = 1;
    reg [31:0] now = 0;  // clocks of the screen
    reg [15:0] number = 0;
    reg [31:0] address = 0;
    reg [31:0] pause = 50;
    reg [15:0] phase = 0;
    reg i_valid = 0;
    reg [10:0] i_payload = 0;
    wire texture = pairs && number[0];
    reg [31:0] wait_spots = 0;
    reg listing = 0;
    reg [31:0] place = 0;
    reg [15:0] overlay_number = 0;
    reg overlay_valid = 0;
    reg [37:0] overlay_payload = 0;

    always @(posedge clk) if (!rst) begin
        i_valid <= 0;
        if (i_valid && i_payload[9]) $fwrite(log, "frame %0d %0d\n", number - 16'd1, now);
        if (pause != 0) begin
            pause <= pause - 1;
        end else begin
            phase <= phase + 1 == period ? 0 : phase + 1;
            if (phase == 0) begin
                i_valid <= 1;
                i_payload <= {1'b0, address == PIXELS - 1, address % WIDTH == WIDTH - 1,
                              pixels[(number % IMAGES) * PIXELS + address]};
                address <= address + 1;
                if (address == PIXELS - 1) begin
                    address <= 0;
                    pause <= blanking;
                    number <= number + 1;
                    if (!texture) begin
                        wait_spots <= delay + 1;
                        overlay_number <= number;
                    end
                end
            end
        end

        overlay_valid <= 0;
        if (wait_spots != 0) begin
            wait_spots <= wait_spots - 1;
            if (wait_spots == 1) begin
                listing <= 1;
                place <= 0;
            end
        end else if (listing) begin
            overlay_valid <= 1;
            overlay_payload <= spots[(overlay_number % LISTS) * LENGTH + place];
            place <= place + 1;
            if (spots[(overlay_number % LISTS) * LENGTH + place][0]) begin
                listing <= 0;
                $fwrite(log, "spots %0d %0d\n", overlay_number, now);
            end
        end
    end

    // The screen's pins, one word a clock.
    wire hsync, vsync, visible;
    wire [COLOUR-1:0] red, green, blue;
    always @(posedge display_clk) if (!rst) begin
        now <= now + 1;
        $fwrite(record, "%u", {5'd0, visible, vsync, hsync, 8'(blue), 8'(green), 8'(red)});
    end
    reg [31:0] screens = 0;
    reg done = 0;
    always @(posedge display_clk) if (now == screens * SCREEN && !rst) begin
        done <= 1;
        $fclose(record);
        $fclose(log);
    end

    wire acquire, held, fetch, turn;
    wire [16:0] frame;
    wire [$clog2(PIXELS)-1:0] address_read;
    wire [$clog2(WIDTH)-1:0] column;
    wire [$clog2(HEIGHT)-1:0] row, fetch_row;
    wire [7:0] data, undrawn, broken, skipped, unread;

    // What a store in an external memory also reports.
    wire [7:0] late;
    wire [15:0] violations, unwritten;
    wire [31:0] reads, writes;

    frame_store store (
`ifdef SRAM
        .fetch(fetch), .fetch_row(fetch_row), .turn(turn), .row(row), .column(column),
        .late(late), .overrun(), .violations(violations), .unwritten(unwritten), .reads(reads),
        .writes(writes),
`else
        .address(address_read),
`endif
        .clk(clk), .rst(rst), .display_clk(display_clk), .display_rst(rst),
        .i_valid(i_valid), .i_payload(i_payload), .info({texture, number}),
        .broken(broken), .skipped(skipped), .unread(unread),
        .acquire(acquire), .give_back(1'b0), .held(held), .frame(frame),
        .idle(), .fresh(), .data(data)
    );

    vga vga (
        .clk(clk), .rst(rst), .display_clk(display_clk), .display_rst(rst),
        .overlay_valid(overlay_valid), .overlay_payload(overlay_payload), .overlay_number(overlay_number),
        .undrawn(undrawn), .acquire(acquire), .held(held), .frame(frame),
        .fetch(fetch), .fetch_row(fetch_row), .turn(turn), .row(row), .column(column),
        .address(address_read), .data(data), .hsync(hsync), .vsync(vsync), .visible(visible),
        .red(red), .green(green), .blue(blue)
    );

endmodule
