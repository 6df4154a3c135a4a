// The external static RAM on the pins of a Verilated design, see hdl/common/sram.py. Call `look`
// after each half clock.
#include <cstdint>
#include <vector>

struct StaticRAM {
    std::vector<uint32_t> words = std::vector<uint32_t>(1 << 19, 0xA5A5A5A5);
    bool writing = false;
    uint32_t address = 0, data = 0, lanes = 0;

    template <class Top> void look(Top& top) {
        bool selected = !top.pins_chip_enable_n;
        bool write = selected && !top.pins_write_enable_n;
        if (writing && !write) {  // the pulse ends: what was there during it is kept
            words[address] = (words[address] & ~lanes) | (data & lanes);
        }
        writing = write;
        if (write) {
            address = top.pins_address;
            data = top.pins_data_drive ? top.pins_data_out : 0xA5A5A5A5;
            lanes = 0;
            for (int lane = 0; lane < 4; ++lane)
                if (!(top.pins_lanes_n >> lane & 1)) lanes |= 0xFFu << 8 * lane;
        }
        bool shows = selected && !top.pins_output_enable_n && !write;
        top.pins_data_in = shows ? words[top.pins_address] : 0xA5A5A5A5;
    }
};
