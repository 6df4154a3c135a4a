-- Undistorted spots to spots with the beam that made them. Twin of epipolar.py, where the
-- contract stands.
--
-- A spot takes ceil(beams / lanes) clocks; the match of its last group follows four clocks later.
-- While o stalls, the whole block stalls. Legal as VHDL-93 and -2008.

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity epipolar is
  generic (
    -- The paper's K, 1 to 512.
    beams : positive := 49;
    -- The paper's P, 1 to beams.
    lanes : positive := 2
  );
  port (
    clk : in std_logic;
    rst : in std_logic;
    i_valid : in std_logic;
    i_ready : out std_logic;
    -- y, x, v, u (18 bits each), border, saturated, area (9), rejected, end
    i_payload : in std_logic_vector(84 downto 0);
    o_valid : out std_logic;
    o_ready : in std_logic;
    -- x, v, u (18 bits each), border, saturated, area (9), beam (9), status (2), end
    o_payload : out std_logic_vector(76 downto 0);
    -- Bank that is tried, and bank that is written and read back.
    bank : in std_logic;
    write_bank : in std_logic;
    write_enable : in std_logic;
    read_enable : in std_logic;
    write_address : in std_logic_vector(8 downto 0);
    -- offset (18 bits), slope (18)
    write_line : in std_logic_vector(35 downto 0);
    -- unused, u_max (13 bits), u_min (13), tolerance (9)
    write_window : in std_logic_vector(35 downto 0);
    -- Such words, in the clock after read_enable.
    read_line : out std_logic_vector(35 downto 0);
    read_window : out std_logic_vector(35 downto 0)
  );
end entity;

architecture rtl of epipolar is

  -- Clocks from the last group of a spot to its result.
  constant depth : positive := 4;
  constant groups : positive := (beams + lanes - 1) / lanes;
  -- Spots that can be on their way at once.
  constant slots : positive := (depth + groups - 1) / groups;
  -- Two lanes share a memory of each kind, which holds the words of all beams.
  constant pairs : positive := (lanes + 1) / 2;

  function bits_for(value : natural) return positive is
    variable bits : positive := 1;
  begin
    while 2 ** bits <= value loop
      bits := bits + 1;
    end loop;
    return bits;
  end function;

  constant index_bits : positive := bits_for(beams - 1);
  constant word_count : positive := 2 ** (index_bits + 1);

  subtype word is std_logic_vector(35 downto 0);
  subtype beam_index is unsigned(index_bits - 1 downto 0);
  subtype word_address is unsigned(index_bits downto 0);
  type memory is array (word_count - 1 downto 0) of word;
  type lane_words is array (2 * pairs - 1 downto 0) of word;

  -- The fields of a spot beside its match: x, v, u, border, saturated, area, rejected, end.
  subtype carried is std_logic_vector(66 downto 0);
  type carried_array is array (slots - 1 downto 0) of carried;

  function to_std_logic(condition : boolean) return std_logic is
  begin
    if condition then
      return '1';
    end if;
    return '0';
  end function;

  function beam_of(base : beam_index; lane : natural) return beam_index is
  begin
    return resize(base + to_unsigned(lane, 10), index_bits);
  end function;

  -- Everything advances, unless a result waits to be taken.
  signal run : std_logic;
  signal result_valid : std_logic := '0';

  signal group_index : integer range 0 to groups - 1 := 0;
  signal base : beam_index;
  signal first, last : std_logic;
  signal taken : std_logic;

  signal waiting : carried_array := (others => (others => '0'));
  signal put, get : integer range 0 to slots - 1 := 0;
  signal oldest : carried;

  -- Clock 1: the words of the group's beams have been read.
  signal line_words, window_words : lane_words;
  signal valid_1, first_1, last_1 : std_logic := '0';
  signal base_1 : beam_index := (others => '0');
  signal x_1, y_1 : signed(17 downto 0) := (others => '0');
  -- Clock 2: product, distance from the offset, window.
  signal valid_2, first_2, last_2 : std_logic := '0';
  signal base_2 : beam_index := (others => '0');
  -- Clock 3: compared.
  signal valid_3, first_3, last_3 : std_logic := '0';
  signal base_3 : beam_index := (others => '0');
  signal on_line, hit : std_logic_vector(lanes - 1 downto 0) := (others => '0');
  -- Clock 4: encoded.
  signal one_hit, many_hits, one_line : std_logic := '0';
  signal beams_hit : beam_index := (others => '0');

begin

  run <= not result_valid or o_ready;
  o_valid <= result_valid;

  -- Lines are tried in groups; the spot is taken with the last one.
  base <= to_unsigned(group_index * lanes, index_bits);
  first <= to_std_logic(group_index = 0);
  last <= to_std_logic(group_index = groups - 1);
  taken <= i_valid and run and last;
  i_ready <= run and last;

  count_groups : process (clk)
  begin
    if rising_edge(clk) then
      if run = '1' and i_valid = '1' then
        if group_index = groups - 1 then
          group_index <= 0;
        else
          group_index <= group_index + 1;
        end if;
      end if;
      if rst = '1' then
        group_index <= 0;
      end if;
    end if;
  end process;

  -- The spot's other fields wait here while the last of its groups is in the pipeline.
  oldest <= waiting(get);

  keep_spots : process (clk)
  begin
    if rising_edge(clk) then
      if taken = '1' then
        waiting(put) <= i_payload(66 downto 0);
        if put = slots - 1 then
          put <= 0;
        else
          put <= put + 1;
        end if;
      end if;
      if result_valid = '1' and o_ready = '1' then
        if get = slots - 1 then
          get <= 0;
        else
          get <= get + 1;
        end if;
      end if;
      if rst = '1' then
        waiting <= (others => (others => '0'));
        put <= 0;
        get <= 0;
      end if;
    end if;
  end process;

  -- If a copy is not as the others, both words are all ones. The sum of an even number of copies is
  -- zero. If there is an odd number the first one is left out: it is what is read, and its faults
  -- show by themselves.
  same_copies : process (line_words, window_words)
    variable line_sum, window_sum, differ : word;
  begin
    line_sum := (others => '0');
    window_sum := (others => '0');
    for pair in pairs mod 2 to pairs - 1 loop
      line_sum := line_sum xor line_words(2 * pair);
      window_sum := window_sum xor window_words(2 * pair);
    end loop;
    differ := (others => '0');
    if line_sum /= word'(others => '0') or window_sum /= word'(others => '0') then
      differ := (others => '1');
    end if;
    read_line <= line_words(0) or differ;
    read_window <= window_words(0) or differ;
  end process;

  -- The host borrows the address of the first read port: with two ports in all, a memory fits into
  -- one dual-port block RAM.
  store : for pair in 0 to pairs - 1 generate
    signal lines, windows : memory := (others => (others => '0'));
    signal address, second : word_address;
    signal host, enable : std_logic;
  begin
    host <= write_enable or read_enable;
    address <= unsigned(write_bank & write_address(index_bits - 1 downto 0)) when host = '1'
               else bank & beam_of(base, 2 * pair);
    second <= bank & beam_of(base, 2 * pair + 1);
    enable <= run or host;

    first_port : process (clk)
    begin
      if rising_edge(clk) then
        if enable = '1' then
          line_words(2 * pair) <= lines(to_integer(address));
          window_words(2 * pair) <= windows(to_integer(address));
        end if;
        if write_enable = '1' then
          lines(to_integer(address)) <= write_line;
          windows(to_integer(address)) <= write_window;
        end if;
      end if;
    end process;

    second_port : process (clk)
    begin
      if rising_edge(clk) then
        if run = '1' then
          line_words(2 * pair + 1) <= lines(to_integer(second));
          window_words(2 * pair + 1) <= windows(to_integer(second));
        end if;
      end if;
    end process;
  end generate;

  move : process (clk)
  begin
    if rising_edge(clk) then
      if run = '1' then
        valid_1 <= i_valid;
        first_1 <= first;
        last_1 <= last;
        base_1 <= base;
        x_1 <= signed(i_payload(66 downto 49));
        y_1 <= signed(i_payload(84 downto 67));
        valid_2 <= valid_1;
        first_2 <= first_1;
        last_2 <= last_1;
        base_2 <= base_1;
        valid_3 <= valid_2;
        first_3 <= first_2;
        last_3 <= last_2;
        base_3 <= base_2;
        result_valid <= valid_3 and last_3;
      end if;
      if rst = '1' then
        valid_1 <= '0';
        first_1 <= '0';
        last_1 <= '0';
        base_1 <= (others => '0');
        x_1 <= (others => '0');
        y_1 <= (others => '0');
        valid_2 <= '0';
        first_2 <= '0';
        last_2 <= '0';
        base_2 <= (others => '0');
        valid_3 <= '0';
        first_3 <= '0';
        last_3 <= '0';
        base_3 <= (others => '0');
        result_valid <= '0';
      end if;
    end if;
  end process;

  try : for lane in 0 to lanes - 1 generate
    signal product : signed(35 downto 0) := (others => '0');
    signal distance : signed(18 downto 0) := (others => '0');
    signal tolerance : unsigned(8 downto 0) := (others => '0');
    signal inside : std_logic := '0';
    signal doubled : signed(20 downto 0);
    signal error, limit : signed(19 downto 0);
    signal near, used : std_logic;
  begin
    -- The product's bit 16 rounds it: it is subtracted at half a weight, and the sum cut.
    doubled <= shift_left(resize(distance, 21), 1) - resize(product(35 downto 16), 21);
    error <= doubled(20 downto 1);
    limit <= signed(resize(tolerance & "0000", 20));
    near <= to_std_logic(error < limit and -limit < error);
    -- A lane without a beam in the last group never hits.
    used <= not last_2 when (groups - 1) * lanes + lane >= beams else '1';

    compare : process (clk)
      variable column : signed(12 downto 0);
    begin
      if rising_edge(clk) then
        if run = '1' then
          product <= signed(line_words(lane)(17 downto 0)) * x_1;
          distance <= resize(y_1, 19) - signed(line_words(lane)(35 downto 18));
          tolerance <= unsigned(window_words(lane)(8 downto 0));
          column := x_1(17 downto 5);
          inside <= to_std_logic(
            column >= signed(window_words(lane)(21 downto 9))
            and column <= signed(window_words(lane)(34 downto 22)));
          on_line(lane) <= near and used;
          hit(lane) <= near and used and inside;
        end if;
        if rst = '1' then
          product <= (others => '0');
          distance <= (others => '0');
          tolerance <= (others => '0');
          inside <= '0';
          on_line(lane) <= '0';
          hit(lane) <= '0';
        end if;
      end if;
    end process;
  end generate;

  -- All beams that hit are or-ed together: the result counts only if there was just one.
  encode : process (clk)
    variable some, several, any_line : std_logic;
    variable beam : beam_index;
  begin
    if rising_edge(clk) then
      some := '0';
      several := '0';
      any_line := '0';
      beam := (others => '0');
      if first_3 = '0' then
        some := one_hit;
        several := many_hits;
        any_line := one_line;
        beam := beams_hit;
      end if;
      for lane in 0 to lanes - 1 loop
        several := several or (some and hit(lane));
        some := some or hit(lane);
        any_line := any_line or on_line(lane);
        if hit(lane) = '1' then
          beam := beam or beam_of(base_3, lane);
        end if;
      end loop;
      if run = '1' and valid_3 = '1' then
        one_hit <= some;
        many_hits <= several;
        one_line <= any_line;
        beams_hit <= beam;
      end if;
      if rst = '1' then
        one_hit <= '0';
        many_hits <= '0';
        one_line <= '0';
        beams_hit <= (others => '0');
      end if;
    end if;
  end process;

  show : process (oldest, one_hit, many_hits, one_line, beams_hit)
    variable status : std_logic_vector(1 downto 0);
    variable beam : beam_index;
  begin
    status := "00";
    beam := (others => '0');
    if oldest(1) = '1' then
      status := "11";
    elsif oldest(0) = '0' then
      if many_hits = '1' then
        status := "10";
      elsif one_hit = '1' then
        beam := beams_hit;
      elsif one_line = '1' then
        status := "11";
      else
        status := "01";
      end if;
    end if;
    o_payload <= oldest(66 downto 2) & std_logic_vector(resize(beam, 9)) & status & oldest(0);
  end process;

end architecture;
