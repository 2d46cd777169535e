# SPDX-License-Identifier: GPL-3.0-or-later

"""The bindings layer misbehaves where ArduPilot's bindings do; a script that flies here must fly there."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import all as dialect

from sitl.vehicles.lua_bindings import LuaScripting
from sitl.vehicles.lua_image import message_image
from tests.lua.stub import FakeVehicle


class Script:
    """Runs pieces of Lua in a fresh engine."""

    def __init__(self) -> None:
        self.vehicle = FakeVehicle()
        self.scripting = LuaScripting(self.vehicle)

    def run(self, text: str) -> None:
        self.scripting.load_text(text, "test.lua")
        self.scripting.run_due(self.vehicle.now_ms)

    def value(self, expression: str) -> str:
        """The value of an expression, as text; an error starts with "error:"."""
        self.vehicle.texts.clear()
        self.run(
            f"local ok, v = pcall(function() return {expression} end) "
            "gcs:send_text(6, ok and tostring(v) or 'error: ' .. tostring(v)) return"
        )
        return self.vehicle.texts[0][1]


@pytest.fixture
def script() -> Script:
    return Script()


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("uint32_t(5) == 5", "false"),
        ("uint32_t(0) ~= 0", "true"),
        ("uint32_t(5) == uint32_t(5)", "true"),
        ("uint32_t(5) < 6", "true"),
        ("uint32_t(5) <= 5", "true"),
        ("uint32_t(100) < -1", "true"),
        ("uint32_t(5) - 10", "4294967291"),
        ("uint32_t(0xFFFFFFFF) + 1", "0"),
        ("uint32_t(7) / 2", "3"),
        ("uint32_t(7) // 2", "3"),
        ("uint32_t(6) ~ 3", "5"),
        ("~uint32_t(0)", "4294967295"),
        ("({[5]='x'})[uint32_t(5)]", "nil"),
        ("type(uint32_t(5))", "userdata"),
        ("uint32_t(5):toint()", "5"),
        ("uint32_t(0xFFFFFFFF):toint()", "-1"),
        ("uint32_t(3000000000):tofloat() == 3000000000.0", "true"),
        ("uint32_t(1e9 + 0.0)", "1000000000"),
        ("uint32_t(0xFFFFFFFF) // 10", "429496729"),
        ("uint32_t(0xFFFFFFFF) % 10", "5"),
        ("uint32_t(0xFFFFFFFE) // 0xFFFFFFFF", "0"),
    ],
)
def test_uint32_is_a_boxed_number(script: Script, expression: str, expected: str) -> None:
    assert script.value(expression) == expected


@pytest.mark.parametrize(
    "expression",
    [
        "uint32_t(5) < -0.5",
        "'x' .. uint32_t(5)",
        "string.format('%d', uint32_t(5))",
        "-uint32_t(5)",
        "uint32_t(5) ^ 2",
        "uint32_t({})",
        "os.time()",
        "debug.sethook()",
        "select('#')",
        "getmetatable(1)",
        "Parameter('NO_SUCH')",
        "tostring(param:get('NO_SUCH'))",
        "vehicle.set_mode(6)",
        "vehicle:set_mode()",
        "vehicle:set_mode(6, 7)",
        "vehicle:set_mode(6.5)",
        "mavlink:receive_chan()",
        "mavlink:init(26, 1)",
        "mavlink:send_chan(0, 47100, '')",
        "gcs:send_text(8, 'x')",
        "logger:write('TOOLONG', 'a', 'B', 1)",
        "logger:write('A', 'a,b', 'B', 1)",
        "logger:write('A', 'a', 'B', 256)",
    ],
)
def test_what_raises_there_raises_here(script: Script, expression: str) -> None:
    assert script.value(expression).startswith("error: ")


def test_errors_are_strings_for_pcall(script: Script) -> None:
    assert script.value("Parameter('NO_SUCH')").endswith("No parameter: NO_SUCH")
    assert script.value("type(pcall(Parameter, 'X') and 1 or 2)") == "number"


def test_failing_getter_returns_no_value(script: Script) -> None:
    assert script.value("#{param:get('NO_SUCH')}") == "0"
    assert script.value("(param:get('NO_SUCH'))") == "nil"
    assert script.value("param:get('MAV_SYSID')") == "1.0"


def test_parameter_values_are_floats(script: Script) -> None:
    assert script.value("math.type(Parameter('MAV_SYSID'):get())") == "float"


def frame(message: dialect.MAVLink_message, system: int = 1) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=191)))


def ping(target: int = 0) -> bytes:
    return frame(dialect.MAVLink_ping_message(0, 1, target, 0))


RECEIVER = "mavlink:init({}, 2) mavlink:register_rx_msgid(4) return"


def test_queue_drops_the_newcomer(script: Script) -> None:
    script.run(RECEIVER.format(2))
    assert [script.scripting.deliver(ping(), 0) for _ in range(3)] == [True, True, False]
    assert script.scripting.dropped_messages == 1


def test_queue_is_common_and_keeps_its_first_size(script: Script) -> None:
    script.run(RECEIVER.format(1))
    script.run("mavlink:init(25, 1) mavlink:register_rx_msgid(4) return")
    assert [script.scripting.deliver(ping(), 0) for _ in range(2)] == [True, False]


def test_init_again_wipes_the_registrations(script: Script) -> None:
    script.run(RECEIVER.format(5))
    assert script.value("mavlink:register_rx_msgid(4)") == "false"
    script.run("mavlink:init(5, 2) return")
    assert not script.scripting.deliver(ping(), 0)
    assert script.value("mavlink:register_rx_msgid(4)") == "true"


def test_full_registration_table_raises(script: Script) -> None:
    script.run("mavlink:init(5, 1) mavlink:register_rx_msgid(4) return")
    assert script.value("mavlink:register_rx_msgid(5)").endswith("no registrations free")


def test_larger_second_init_is_a_memory_overrun_not_a_lua_error(script: Script) -> None:
    script.run("mavlink:init(5, 1) return")
    with pytest.raises(RuntimeError, match="overruns the table"):
        script.run("pcall(mavlink.init, mavlink, 5, 2) return")


def test_short_payload_is_a_memory_over_read_not_a_lua_error(script: Script) -> None:
    with pytest.raises(RuntimeError, match="9 bytes, 10 are read"):
        script.run("pcall(mavlink.send_chan, mavlink, 0, 77, string.rep('\\0', 9)) return")


PING = "mavlink:send_chan({}, 4, string.rep('\\0', 14))"


@pytest.mark.parametrize("firmware", [(4, 5, 7), (4, 6, 3), (4, 7, 0)])
def test_a_message_to_a_channel_without_a_port_ends_the_process(script: Script, firmware: tuple[int, int, int]) -> None:
    script.vehicle.firmware_version = firmware
    script.vehicle.ports = {0, 1}
    assert script.value(PING.format(1)) == "true"
    with pytest.raises(RuntimeError, match="no port has channel 2"):
        script.run(f"pcall(function() {PING.format(2)} end) return")


def test_the_release_of_4_7_answers_no(script: Script) -> None:
    script.vehicle.firmware_version = (4, 7, 1)
    script.vehicle.ports = {0, 1}
    assert script.value(PING.format(2)) == "false"


@pytest.mark.parametrize(("firmware", "buffers"), [((4, 5, 7), 7), ((4, 6, 3), 8), ((4, 7, 0), 8), ((4, 7, 1), 16)])
def test_a_channel_past_the_buffers_raises(script: Script, firmware: tuple[int, int, int], buffers: int) -> None:
    script.vehicle.firmware_version = firmware
    script.vehicle.ports = set(range(buffers))
    assert script.value(PING.format(buffers - 1)) == "true"
    assert "out of range" in script.value(PING.format(buffers))


@pytest.mark.parametrize("firmware", [(4, 5, 7), (4, 7, 1)])
def test_a_second_init_changes_nothing_on_4_5_and_4_7(script: Script, firmware: tuple[int, int, int]) -> None:
    script.vehicle.firmware_version = firmware
    script.run("mavlink:init(5, 1) mavlink:register_rx_msgid(4) mavlink:init(5, 9) return")
    assert script.value("mavlink:register_rx_msgid(4)") == "false"
    assert script.value("mavlink:register_rx_msgid(5)").endswith("no registrations free")


@pytest.mark.parametrize("value", ["true", "'1'", "-2147483904.0", "4294967296.0"])
def test_a_log_field_of_32_bits_takes_numbers_only(script: Script, value: str) -> None:
    """These numbers are the same in a Lua of 32 bits: -2^31 has no float between itself and the first one there."""
    assert script.value(f"logger:write('A', 'x', 'I', {value})").startswith("error: ")


def test_log_message_defined_twice_halts_sitl(script: Script) -> None:
    script.run("logger:write('A', 'x', 'B', 1) logger:write('A', 'x', 'B', 2) return")
    with pytest.raises(RuntimeError, match="defined twice"):
        script.run("pcall(logger.write, logger, 'A', 'y', 'B', 1) return")


def test_messages_for_others_are_not_delivered(script: Script) -> None:
    script.run(RECEIVER.format(9))
    assert [script.scripting.deliver(ping(target), 0) for target in (0, 1, 2)] == [True, True, False]


def test_image_is_the_memory_of_a_mavlink_message() -> None:
    raw = ping()
    image = message_image(raw)
    assert image is not None
    assert len(image) == 291
    length = raw[1]
    assert image[:2] == raw[10 + length : 12 + length]
    assert image[2] == 0xFD
    assert image[3] == length
    assert image[3:12] == raw[1:10]
    assert image[12 : 12 + length] == raw[10 : 10 + length]
    assert image[276:278] == image[:2]


def test_unknown_message_shows_what_an_earlier_one_left() -> None:
    unknown = bytes((0xFD, 2, 0, 0, 0, 1, 1)) + (47100).to_bytes(3, "little") + b"\xde\xad" + b"\x00\x00"
    image = message_image(unknown, bytes(range(1, 200)))
    assert image is not None
    assert image[12:16] == b"\xde\xad\x03\x04"


@pytest.mark.parametrize("raw", [b"", b"\xfd", b"\x55" * 30, ping()[:-1], ping() + b"\x00"])
def test_what_is_not_one_frame_is_dropped(script: Script, raw: bytes) -> None:
    script.run(RECEIVER.format(9))
    assert not script.scripting.deliver(raw, 0)


class TestEngine:
    def test_update_runs_when_due(self, script: Script) -> None:
        script.run("local function f() gcs:send_text(6, 'run') return f, 50 end return f()")
        assert script.scripting.next_run_ms() == script.vehicle.now_ms + 50
        for _ in range(10):
            script.vehicle.now_ms += 10
            script.scripting.run_due(script.vehicle.now_ms)
        assert script.vehicle.texts == [(6, "run")] * 3

    @pytest.mark.parametrize(
        ("text", "part"),
        [
            ("error('boom')", "boom"),
            ("this is no Lua", "test.lua:1"),
            ("return 5, 10", "did not return a function"),
            ("return function() end, 'x'", "did not return a delay"),
            ("return nil_function()", "nil_function"),
        ],
    )
    def test_faulty_script_is_removed_and_blocks_arming(self, script: Script, text: str, part: str) -> None:
        script.run(text)
        assert script.scripting.scripts == ()
        assert part in script.vehicle.removed[0]
        assert (script.scripting.arming_refusal() or "").startswith("Scripting: ")

    def test_script_that_returns_nothing_ends_quietly(self, script: Script) -> None:
        script.run("return")
        assert script.scripting.scripts == ()
        assert script.scripting.arming_refusal() is None

    @pytest.mark.parametrize("counting", [False, True])
    def test_pcall_does_not_save_from_the_instruction_limit(self, counting: bool) -> None:
        vehicle = FakeVehicle()
        scripting = LuaScripting(vehicle, count_instructions=counting)
        scripting.load_text(
            "local function f() while true do pcall(function() while true do end end) end return f, 1 end return f()",
            "hog.lua",
        )
        scripting.run_due(vehicle.now_ms)
        assert scripting.scripts == ()
        assert vehicle.removed == ["hog.lua: hog.lua exceeded time limit"]

    def test_the_others_go_on(self, script: Script) -> None:
        script.run("local function f() return f, 10 end return f()")
        script.run("while true do end")
        script.scripting.run_due(script.vehicle.now_ms + 1000)
        assert script.scripting.scripts == ("test.lua",)

    def test_counted_instructions_are_the_scripts_own(self) -> None:
        vehicle = FakeVehicle()
        scripting = LuaScripting(vehicle, count_instructions=True)
        scripting.load_text("for _ = 1, 100 do end return", "loop.lua")
        scripting.run_due(vehicle.now_ms)
        assert 100 < scripting.instructions < 110

    def test_fault_of_the_host_is_not_hidden_by_pcall(self, script: Script) -> None:
        def broken() -> bool:
            raise OSError("vehicle model is broken")

        script.vehicle.is_armed = broken  # type: ignore[method-assign]
        with pytest.raises(OSError, match="vehicle model is broken"):
            script.run("pcall(arming.is_armed, arming) return")


class TestStopping:
    KEEPER = "arming:set_aux_auth_passed(arming:get_aux_auth_id()) mavlink:block_command(99) return"

    def stopped_by_parameter(self, script: Script) -> None:
        script.vehicle.parameters["SCR_ENABLE"] = 0.0
        script.scripting.run_due(script.vehicle.now_ms)

    def stopped_by_command(self, script: Script) -> None:
        assert script.scripting.scripting_command(2.0) == 0

    @pytest.mark.parametrize("how", [stopped_by_parameter, stopped_by_command])
    def test_authorisation_stays_and_commands_are_free(
        self, script: Script, how: Callable[[TestStopping, Script], None]
    ) -> None:
        script.run(self.KEEPER)
        assert script.scripting.command_blocked(99)
        how(self, script)
        assert script.scripting.arming_refusal() is None
        assert not script.scripting.command_blocked(99)

    def test_restart_forgets_authorisations(self, script: Script) -> None:
        script.run("arming:set_aux_auth_failed(arming:get_aux_auth_id(), 'no') return")
        assert script.scripting.arming_refusal() == "no"
        assert script.scripting.scripting_command(3.0) == 0
        assert script.scripting.arming_refusal() is None

    def test_other_scripting_commands_are_refused(self, script: Script) -> None:
        assert [script.scripting.scripting_command(p) for p in (0.0, 1.0, 4.0)] == [2, 2, 3]


def test_parameter_table_rules(script: Script) -> None:
    assert script.value("param:add_table(5, 'A_', 2)") == "true"
    assert script.value("param:add_table(5, 'A_', 2)") == "true"
    assert script.value("param:add_table(5, 'B_', 2)") == "false"
    assert script.value("param:add_table(5, 'A_', 3)") == "false"
    assert script.value("param:add_param(5, 3, 'X', 1)") == "false"
    assert script.value("param:add_param(5, 1, 'LONGER_THAN_16', 1)") == "true"
    assert script.value("param:add_param(5, 1, 'LONGER_THAN_16_', 1)") == "false"
    assert script.value("param:add_param(6, 1, 'X', 1)") == "false"


def test_fourth_authoriser_blocks_arming_for_good(script: Script) -> None:
    script.run("for _ = 1, 4 do arming:get_aux_auth_id() end return")
    assert script.scripting.arming_refusal() == "Too many auxiliary authorisers"
