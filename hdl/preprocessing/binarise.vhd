-- Marks each pixel at or above a level as lit. Twin of binarise.py.
--
-- A pixel leaves one clock after it came in; one pixel a clock as long as o_ready stays high.
-- level and enable are sampled with each pixel; without enable, and on a
-- broken beat, the pixel is dark. Legal as VHDL-93 and -2008.

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity binarise is
  generic (
    pixel_bits : positive := 8
  );
  port (
    clk : in std_logic;
    rst : in std_logic;
    i_valid : in std_logic;
    -- broken, frame_end, line_end, grey
    i_payload : in std_logic_vector(pixel_bits + 2 downto 0);
    i_ready : out std_logic;
    o_valid : out std_logic;
    -- broken, frame_end, line_end, excess, saturated (always low), core, lit
    o_payload : out std_logic_vector(pixel_bits + 5 downto 0);
    o_ready : in std_logic;
    level : in std_logic_vector(pixel_bits - 1 downto 0);
    enable : in std_logic
  );
end entity;

architecture rtl of binarise is
  signal valid : std_logic := '0';
  signal payload : std_logic_vector(pixel_bits + 5 downto 0) := (others => '0');
  signal free : std_logic;
begin

  -- The output register is free when it is empty or being emptied.
  free <= not valid or o_ready;
  i_ready <= free;
  o_valid <= valid;
  o_payload <= payload;

  register_pixel : process (clk)
    variable excess : unsigned(pixel_bits downto 0);
  begin
    if rising_edge(clk) then
      if free = '1' then
        valid <= i_valid;
        payload <= (others => '0');
        payload(pixel_bits + 5 downto pixel_bits + 3) <=
          i_payload(pixel_bits + 2 downto pixel_bits);
        -- One subtraction compares (a borrow: darker than the level) and gives the excess.
        excess := ('0' & unsigned(i_payload(pixel_bits - 1 downto 0))) - ('0' & unsigned(level));
        if enable = '1' and excess(pixel_bits) = '0' and i_payload(pixel_bits + 2) = '0' then
          payload(1 downto 0) <= "11";
          payload(pixel_bits + 2 downto 3) <= std_logic_vector(excess(pixel_bits - 1 downto 0));
        end if;
      end if;
      if rst = '1' then
        valid <= '0';
        payload <= (others => '0');
      end if;
    end if;
  end process;

end architecture;
