-- Octets to a serial line. Twin of uart_tx.py, where the contract stands.
--
-- The start bit begins the clock after an octet was taken; the next octet is taken in the stop
-- bit's last clock. Legal as VHDL-93 and -2008.

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity uart_tx is
  port (
    clk : in std_logic;
    rst : in std_logic;
    i_valid : in std_logic;
    i_ready : out std_logic;
    i_payload : in std_logic_vector(7 downto 0);
    -- clocks per bit; 0 counts as 1
    divisor : in std_logic_vector(15 downto 0);
    tx : out std_logic
  );
end entity;

architecture rtl of uart_tx is

  -- Still to be sent; the lowest one is on the line.
  signal bits : std_logic_vector(8 downto 0) := (others => '1');
  -- So many after it, the stop bit included.
  signal follow : integer range 0 to 9 := 0;
  -- Clocks left of this bit, less one: negative in its last clock, and until there is more.
  signal left_over : signed(16 downto 0) := (others => '1');
  signal last_clock, ready : std_logic;

begin

  last_clock <= left_over(16);
  ready <= last_clock when follow = 0 else '0';
  i_ready <= ready;
  tx <= bits(0);

  shift : process (clk)
  begin
    if rising_edge(clk) then
      if last_clock = '0' then
        left_over <= left_over - 1;
      elsif follow /= 0 or i_valid = '1' then
        left_over <= signed('0' & divisor) - 2;
      end if;
      if ready = '1' and i_valid = '1' then
        bits <= i_payload & '0';
        follow <= 9;
      elsif last_clock = '1' then
        bits <= '1' & bits(8 downto 1);
        if follow /= 0 then
          follow <= follow - 1;
        end if;
      end if;
      if rst = '1' then
        bits <= (others => '1');
        follow <= 0;
        left_over <= (others => '1');
      end if;
    end if;
  end process;

end architecture;
