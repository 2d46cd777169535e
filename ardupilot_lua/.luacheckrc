-- SPDX-License-Identifier: GPL-3.0-or-later
--
-- luacheck --config ardupilot_lua/.luacheckrc ardupilot_lua
--
-- Stricter than ArduPilot's own configuration, which lets undefined globals pass: here every binding that a script
-- uses is named, so a misspelt one is found on the desk. ArduPilot's run_luacheck.sh is satisfied by what satisfies this.

std = "lua53"
max_line_length = 120
max_comment_line_length = false     -- ArduPilot keeps each @Description on one line

-- what ArduPilot takes away from Lua: using it would kill the script in flight
not_globals = {"os", "debug", "coroutine", "utf8", "select", "getmetatable", "dofile", "loadfile", "load", "print"}

local function methods(...)
    local fields = {}
    for _, name in ipairs({...}) do
        fields[name] = {other_fields = false}
    end
    return {other_fields = false, fields = fields}
end

read_globals = {
    "millis",
    "micros",
    "Parameter",
    vehicle = methods("set_mode", "get_mode", "get_control_mode_reason", "get_likely_flying", "is_landing",
                      "is_taking_off", "has_ekf_failsafed"),
    quadplane = methods("in_vtol_mode"),    -- ArduPlane
    mission = methods("get_current_nav_index"),
    arming = methods("is_armed", "disarm", "get_aux_auth_id", "set_aux_auth_passed", "set_aux_auth_failed"),
    param = methods("get", "set", "add_table", "add_param"),
    gcs = methods("send_text"),
    rc = methods("has_valid_input", "run_aux_function"),
    logger = methods("write"),
    ahrs = methods("get_gyro", "get_accel"),
    baro = methods("get_pressure"),
    battery = methods("voltage"),
    gps = methods("time_week_ms"),
    mavlink = methods("init", "register_rx_msgid", "receive_chan", "send_chan", "block_command"),
    FWVersion = methods("type", "major", "minor"),
}
