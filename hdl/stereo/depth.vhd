-- Spots with their beam to points. Twin of depth.py, where the contract stands.
--
-- A point appears five clocks after its spot, which waits at i until the point is taken. Legal as
-- VHDL-93 and -2008.

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity depth is
  port (
    clk : in std_logic;
    rst : in std_logic;
    i_valid : in std_logic;
    i_ready : out std_logic;
    -- x, v, u (18 bits each), border, saturated, area (9), beam (9), status (2), end
    i_payload : in std_logic_vector(76 downto 0);
    o_valid : out std_logic;
    o_ready : in std_logic;
    -- inverse_z, v, u (18 bits each), border, saturated, area (9), beam (9), status (2), end
    o_payload : out std_logic_vector(76 downto 0);
    -- 2 * beam for alpha, 2 * beam + 1 for beta
    table_address : out std_logic_vector(9 downto 0);
    -- beta (36 bits), or alpha (18), one clock later
    table_data : in std_logic_vector(35 downto 0)
  );
end entity;

architecture rtl of depth is

  constant half : signed(36 downto 0) := to_signed(2048, 37);
  constant rejected : std_logic_vector(1 downto 0) := "11";

  -- Starts at one half, takes beta, then the product. Spots that have no depth are set back to one
  -- half before they are shown, and so read zero.
  signal total : signed(36 downto 0) := half;
  signal addend : signed(36 downto 0);
  -- One-hot: beta is there, alpha is there, the total is there, it is checked.
  signal step : std_logic_vector(3 downto 0) := (others => '0');
  signal result_valid : std_logic := '0';
  signal failed : std_logic := '0';
  -- The parts of the check: four bits each of the integer are zero; it is negative or too large.
  signal zero : std_logic_vector(4 downto 0) := (others => '0');
  signal above : std_logic_vector(1 downto 0) := (others => '0');
  signal ok, far, taken : std_logic;

begin

  taken <= result_valid and o_ready;
  ok <= '1' when i_payload(2 downto 0) = "000" else '0';
  far <= '1' when zero = "11111" or above /= "00" else '0';

  table_address <= i_payload(11 downto 3) & not step(0);
  addend <= resize(signed(table_data), 37) when step(0) = '1' else
            resize(signed(table_data(17 downto 0)) * signed(i_payload(76 downto 59)), 37);

  add : process (clk)
  begin
    if rising_edge(clk) then
      step <= step(2 downto 0) & '0';
      if i_valid = '1' and step = "0000" and result_valid = '0' then
        step(0) <= '1';
      end if;
      if step(0) = '1' or step(1) = '1' then
        total <= total + addend;
      end if;
      if taken = '1' or (step(3) = '1' and (ok = '0' or far = '1')) then
        total <= half;
      end if;
      if step(3) = '1' then
        result_valid <= '1';
        failed <= ok and far;
      end if;
      if taken = '1' then
        result_valid <= '0';
      end if;
      if rst = '1' then
        total <= half;
        step <= (others => '0');
        result_valid <= '0';
        failed <= '0';
      end if;
    end if;
  end process;

  check : process (clk)
    variable integer_part : signed(24 downto 0);
  begin
    if rising_edge(clk) then
      integer_part := total(36 downto 12);
      zero <= (others => '0');
      above <= (others => '0');
      for nibble in 0 to 3 loop
        if integer_part(4 * nibble + 3 downto 4 * nibble) = "0000" then
          zero(nibble) <= '1';
        end if;
      end loop;
      if integer_part(17 downto 16) = "00" then
        zero(4) <= '1';
      end if;
      if integer_part(21 downto 18) /= "0000" then
        above(0) <= '1';
      end if;
      if integer_part(24 downto 22) /= "000" then
        above(1) <= '1';
      end if;
      if rst = '1' then
        zero <= (others => '0');
        above <= (others => '0');
      end if;
    end if;
  end process;

  i_ready <= taken;
  o_valid <= result_valid;
  o_payload(76 downto 59) <= std_logic_vector(total(29 downto 12));
  o_payload(58 downto 12) <= i_payload(58 downto 12);
  o_payload(11 downto 3) <= (others => '0') when failed = '1' else i_payload(11 downto 3);
  o_payload(2 downto 1) <= rejected when failed = '1' else i_payload(2 downto 1);
  o_payload(0) <= i_payload(0);

end architecture;
