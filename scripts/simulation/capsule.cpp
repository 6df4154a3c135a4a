// The Verilated capsule as a plain C library: frames in at the camera's pins, octets out of the
// serial pin. No VPI; one pixel a clock. The spot side's clock stands still while it is not busy; the
// line is read at one clock a bit. With PAPER defined it is the preset paper, its memory beside it.
#include "Vcapsule.h"
#include "verilated.h"

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace {

struct Harness {
    VerilatedContext context;
    Vcapsule top{&context, "TOP"};
    uint64_t clocks = 0;
    int bit = -1;  // position in the character on the serial line; -1 between characters
    uint8_t character = 0;
    std::vector<uint8_t> octets;

#ifdef PAPER
    StaticRAM ram;
    uint32_t screen = 0;  // clocks of the screen for 1024 of the system
    bool taken = false;  // the memory took a command
    bool watched = false;
    std::vector<uint32_t> seen;  // the screen's pins: red, green, blue, then sync and visible

    void clock(bool spot_side = false) {
        top.clk = top.spot_clk = 0;
        top.eval();
        ram.look(top);
        taken = top.memory_valid && top.memory_ready;
        top.clk = 1;
        top.spot_clk = top.busy | spot_side;
        top.eval();
        ram.look(top);
        for (uint64_t n = (clocks + 1) * screen / 1024 - clocks * screen / 1024; n; --n) {
            top.display_clk ^= 1;  // every change is a rising edge, see library.py
            top.eval();
            if (watched) {
                seen.push_back(top.red | top.green << 8 | top.blue << 16 | top.hsync << 24
                               | top.vsync << 25 | top.visible << 26);
            }
        }
#else
    void clock(bool spot_side = false) {
        // Every change of a clock is a rising edge here, see library.py.
        top.clk ^= 1;
        top.spot_clk ^= top.busy | spot_side;
        top.eval();
#endif
        ++clocks;
        if (bit < 0) {
            if (!top.tx) bit = 0, character = 0;
        } else if (bit < 8) {
            character |= static_cast<uint8_t>(top.tx << bit++);
        } else {
            octets.push_back(character);
            bit = -1;
        }
    }
};

}  // namespace

extern "C" {

Harness* capsule_new() {
    auto harness = new Harness;
    harness->top.cts = 1;
    return harness;
}

void capsule_free(Harness* harness) {
    harness->top.final();
    delete harness;
}

uint64_t capsule_clocks(const Harness* harness) { return harness->clocks; }

// Sets a register; false if the chip has none of that name. REGISTERS(SET) stands for SET(name) of
// every register and is defined before this file, from the chip's list.
bool capsule_set(Harness* harness, const char* name, uint32_t value) {
#define SET(port) if (!std::strcmp(name, #port)) return harness->top.port = value, true;
    REGISTERS(SET)
#undef SET
    return false;
}

// One word of a table; `word` holds 72 bits in three 32-bit parts, low part first.
void capsule_write_table(Harness* harness, int select, uint32_t address, const uint32_t* word) {
    auto& top = harness->top;
    top.table_write = 1;
    top.table_select = select;
    top.table_address = address;
    for (int i = 0; i < 3; ++i) top.table_data[i] = word[i];
    harness->clock(true);
    top.table_write = 0;
    harness->clock(true);
}

// Measures with the tables that were written, and lets the others be written from now on.
void capsule_swap(Harness* harness) { harness->top.bank ^= 1; }

#ifdef PAPER
// Writes words to the external memory, through the chip.
void capsule_write_memory(Harness* harness, uint32_t address, const uint32_t* word, size_t count) {
    auto& top = harness->top;
    for (size_t i = 0; i < count; ++i) {
        top.memory_valid = 1;
        top.memory_payload = 1 | uint64_t{address + i} << 1 | uint64_t{word[i]} << 20
            | uint64_t{15} << 52;
        do harness->clock(); while (!harness->taken);
    }
    top.memory_valid = 0;
}

// Lets the screen run, so many clocks for 1024 of the system; keeps what it shows if watched.
void capsule_screen(Harness* harness, uint32_t clocks, int watched) {
    harness->screen = clocks;
    harness->watched = watched;
}

// Takes what the screen has shown; returns how many clocks that was.
size_t capsule_seen(Harness* harness, uint32_t* out, size_t room) {
    size_t count = harness->seen.size() < room ? harness->seen.size() : room;
    for (size_t i = 0; i < count; ++i) out[i] = harness->seen[i];
    harness->seen.clear();
    return count;
}
#endif

// Shows one frame at the camera's pins, with blanking after each line and after the frame.
void capsule_frame(Harness* harness, const uint8_t* grey, size_t height, size_t width,
                   size_t line_blanking, size_t frame_blanking) {
    auto& top = harness->top;
    top.frame_valid = 1;
    for (size_t row = 0; row < height; ++row) {
        top.line_valid = 1;
        for (size_t column = 0; column < width; ++column) {
            top.data = *grey++;
            harness->clock();
        }
        top.line_valid = 0;
        for (size_t i = 0; i < line_blanking; ++i) harness->clock();
    }
    top.frame_valid = 0;
    for (size_t i = 0; i < frame_blanking; ++i) harness->clock();
#ifdef PAPER
    // A frame that comes before this one has been measured would be skipped.
    for (uint64_t i = 0; i < 4000000 && !top.idle; ++i) harness->clock();
#endif
}

void capsule_idle(Harness* harness, uint64_t clocks) {
    while (clocks--) harness->clock();
}

// Takes the octets that have come; returns how many there were.
size_t capsule_octets(Harness* harness, uint8_t* out, size_t room) {
    size_t count = harness->octets.size() < room ? harness->octets.size() : room;
    for (size_t i = 0; i < count; ++i) out[i] = harness->octets[i];
    harness->octets.erase(harness->octets.begin(), harness->octets.begin() + count);
    return count;
}

}  // extern "C"
