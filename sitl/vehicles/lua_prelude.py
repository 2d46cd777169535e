# SPDX-License-Identifier: GPL-3.0-or-later

"""The Lua half of ArduPilot's script bindings: the globals that a script sees, and how they misbehave.

Written in Lua because only Lua code can raise a Lua error whose message is a string, as the autopilot's
bindings do; an exception of Python reaches `pcall` as an object. Each binding checks its receiver and its
number of arguments as ArduPilot's generated code does, then calls the Python half (`lua_calls.ScriptCalls`),
which answers `true, values...` or `false, message`.

Three habits of the autopilot are kept, because scripts stumble over them in flight:

- `uint32_t` is a boxed number. It compares with `<` and `<=` against numbers but never equals one. It is no
  table key, has no `..`, and refuses an operand that does not fit.
- A getter that fails returns *no value*, not nil.
- A script sees neither `os`, `debug`, `coroutine`, `select` nor `getmetatable`.

Lua itself is not ArduPilot's here, unless it was built with LUA_32BITS (`python -m tests.lua.run_32bit`): integers have
64 bits and floats are doubles, the autopilot has 32 of each. This file is right with both.
"""

from __future__ import annotations

__all__ = ["LUA_PRELUDE"]

LUA_PRELUDE = r"""
local py, absent = ...
local MASK = 0xFFFFFFFF

local function pass(level, ok, ...)
    if not ok then error((...), level) end
    return ...
end

-- ---------------------------------------------------------------- uint32_t
local VALUE = {}                    -- private key: scripts cannot reach the number inside
local box = {}
local methods = {}

local function is_boxed(x)
    return type(x) == "table" and rawget(x, VALUE) ~= nil
end

local function new(v)
    return setmetatable({[VALUE] = v & MASK}, box)
end

local function coerce(x)
    if is_boxed(x) then return rawget(x, VALUE) end
    local n = tonumber(x)
    if n ~= nil then
        local whole = math.tointeger(n)
        if whole ~= nil and (math.type(n) == "integer" or (n >= -2147483648.0 and n < 2147483648.0)) then
            return whole & MASK
        end
        if n >= 2147483648.0 and n <= 4294967295.0 then
            if n >= 4294967295.0 then return MASK end
            return (math.tointeger(n - 4294967296.0) or math.floor(n - 4294967296.0)) & MASK
        end
        if n >= 0 and n < 2147483648.0 then return math.floor(n) & MASK end
    end
    error("bad argument (Unable to coerce to uint32_t)", 3)
end

local function binary(f)
    return function(a, b) return new(f(coerce(a), coerce(b))) end
end

box.__index = function(_, key)
    return methods[key]
end
box.__newindex = function() error("attempt to index a uint32_t value", 2) end
box.__metatable = "uint32_t"
box.__add = binary(function(a, b) return a + b end)
box.__sub = binary(function(a, b) return a - b end)
box.__mul = binary(function(a, b) return a * b end)
local function divide(a, b)         -- unsigned, whatever the width of Lua's integers
    if b < 0 then return math.ult(a, b) and 0 or 1 end
    local q = ((a >> 1) // b) << 1
    if not math.ult(a - q * b, b) then q = q + 1 end
    return q
end
box.__div = binary(divide)
box.__idiv = box.__div
box.__mod = binary(function(a, b) return a - divide(a, b) * b end)
box.__band = binary(function(a, b) return a & b end)
box.__bor = binary(function(a, b) return a | b end)
box.__bxor = binary(function(a, b) return a ~ b end)
box.__shl = binary(function(a, b) return a << b end)
box.__shr = binary(function(a, b) return a >> b end)
box.__bnot = function(a) return new(~coerce(a)) end
box.__eq = function(a, b) return coerce(a) == coerce(b) end
box.__lt = function(a, b) return math.ult(coerce(a), coerce(b)) end
box.__le = function(a, b) return not math.ult(coerce(b), coerce(a)) end
box.__tostring = function(a)
    local v = rawget(a, VALUE)
    local tens = divide(v, 10)
    return (tens > 0 and string.format("%d", tens) or "") .. string.format("%d", v - tens * 10)
end

function methods.toint(self)        -- 32-bit integers on the autopilot: the upper half comes out negative
    local v = coerce(self)
    if v > 0x7FFFFFFF then v = v - 0x100000000 end
    return v
end
function methods.tofloat(self)
    local v = coerce(self)
    return v < 0 and v + 4294967296.0 or v + 0.0
end

-- ---------------------------------------------------------------- objects with checked methods
local function object(name, dotted)
    local self = {}
    local function method(key, wanted, f)
        if absent[name .. "." .. key] then return end
        self[key] = function(...)
            local n, first = select("#", ...), (...)
            if first == self then
                if n - 1 ~= wanted then error("bad argument count for '" .. key .. "'", 2) end
                return f(select(2, ...))
            end
            if not dotted then error("bad argument #1 to '" .. key .. "' (" .. name .. " expected)", 2) end
            if n ~= wanted then error("bad argument count for '" .. key .. "'", 2) end
            return f(...)
        end
    end
    return self, method
end

local function forward(f)
    return function(...) return pass(4, f(...)) end
end

local env = {
    assert = assert, error = error, ipairs = ipairs, load = load, next = next, pairs = pairs, pcall = pcall,
    setmetatable = setmetatable, tonumber = tonumber, tostring = tostring,
    math = math, table = table, string = string,
}
env.type = function(x)
    if is_boxed(x) then return "userdata" end
    return type(x)
end
env.uint32_t = function(v) return new(v == nil and 0 or coerce(v)) end
env.millis = function() return new((pass(3, py.millis()))) end
env.micros = function() return new((pass(3, py.micros()))) end

local vehicle, add = object("vehicle")
add("set_mode", 1, forward(py.set_mode))
add("get_mode", 0, forward(py.get_mode))
add("get_control_mode_reason", 0, forward(py.get_control_mode_reason))
add("get_likely_flying", 0, forward(py.get_likely_flying))
add("is_landing", 0, forward(py.is_landing))
add("is_taking_off", 0, forward(py.is_taking_off))
add("has_ekf_failsafed", 0, forward(py.has_ekf_failsafed))
add("get_time_flying_ms", 0, function() return new((pass(4, py.get_time_flying_ms()))) end)

local arming
arming, add = object("arming")
add("is_armed", 0, forward(py.is_armed))
add("arm", 0, forward(py.arm))
add("disarm", 0, forward(py.disarm))
add("get_aux_auth_id", 0, forward(py.get_aux_auth_id))
add("set_aux_auth_passed", 1, forward(py.set_aux_auth_passed))
add("set_aux_auth_failed", 2, forward(py.set_aux_auth_failed))

local param
param, add = object("param")
add("get", 1, forward(py.param_get))
add("set", 2, forward(py.param_set))
add("set_and_save", 2, forward(py.param_set_and_save))
add("add_table", 3, forward(py.param_add_table))
add("add_param", 4, forward(py.param_add_param))

-- files: read whole when opened, and only those that the host gives
env.io = {open = function(path)
    local content = pass(3, py.read_file(path))
    if content == nil then return nil, path .. ": No such file or directory" end
    local file = {}
    function file.read(_, size)
        if content == "" then return nil end
        local part = string.sub(content, 1, size)
        content = string.sub(content, size + 1)
        return part
    end
    function file.close() return true end
    return file
end}

env.Parameter = function(name)
    if name ~= nil then pass(3, py.parameter_exists(name)) end
    local self = {}
    local bound = name
    function self.init(_, new_name)
        local found = py.parameter_exists(new_name)
        if found then bound = new_name end
        return found
    end
    function self.get(_) return pass(3, py.param_get(bound)) end
    function self.set(_, v) return pass(3, py.param_set(bound, v)) end
    function self.set_and_save(_, v) return pass(3, py.param_set_and_save(bound, v)) end
    return self
end

local gcs
gcs, add = object("gcs")
add("send_text", 2, forward(py.send_text))
add("last_seen", 0, function() return new((pass(4, py.gcs_last_seen()))) end)

local function vector(x, y, z)
    local self, member = object("Vector3f")
    member("x", 0, function() return x end)
    member("y", 0, function() return y end)
    member("z", 0, function() return z end)
    return self
end

local ahrs
ahrs, add = object("ahrs")
add("get_gyro", 0, function() return vector(pass(4, py.get_gyro())) end)
add("get_accel", 0, function() return vector(pass(4, py.get_accel())) end)

local baro
baro, add = object("baro")
add("get_pressure", 0, forward(py.get_pressure))

local battery
battery, add = object("battery")
add("voltage", 1, forward(py.battery_voltage))

local gps
gps, add = object("gps")
add("time_week_ms", 1, function(instance) return new((pass(4, py.gps_week_ms(instance)))) end)

local rc
rc, add = object("rc")
add("has_valid_input", 0, forward(py.rc_has_valid_input))
add("run_aux_function", 2, forward(py.rc_run_aux_function))

local mavlink
mavlink, add = object("mavlink", true)
add("init", 2, forward(py.mavlink_init))
add("register_rx_msgid", 1, forward(py.mavlink_register))
add("block_command", 1, forward(py.mavlink_block_command))
add("send_chan", 3, forward(py.mavlink_send_chan))
add("receive_chan", 0, function()
    local some, msg, chan, stamp = pass(4, py.mavlink_receive())
    if some then return msg, chan, new(stamp) end
end)

local logger = {}
function logger.write(self, ...)
    local values = {...}
    if self ~= logger then table.insert(values, 1, self) end
    for i, v in ipairs(values) do
        if is_boxed(v) then values[i] = rawget(v, VALUE) end
    end
    pass(3, py.log_write(table.unpack(values)))
end
if absent["logger.write"] then logger.write = nil end

local mission
mission, add = object("mission")
add("get_current_nav_index", 0, forward(py.get_current_nav_index))

if pass(3, py.fw_type()) == 3 then       -- ArduPlane alone has it
    env.quadplane, add = object("quadplane")
    add("in_vtol_mode", 0, forward(py.in_vtol_mode))
end

local version
version, add = object("FWVersion")
add("type", 0, forward(py.fw_type))
add("major", 0, forward(py.fw_major))
add("minor", 0, forward(py.fw_minor))
add("patch", 0, forward(py.fw_patch))

env.vehicle, env.arming, env.param, env.gcs, env.rc = vehicle, arming, param, gcs, rc
env.mavlink, env.logger, env.FWVersion, env.mission = mavlink, logger, version, mission
env.ahrs, env.baro, env.battery, env.gps = ahrs, baro, battery, gps
for name in pairs(absent) do env[name] = nil end

-- ---------------------------------------------------------------- running within the instruction budget
local state = {running = false, counting = false, overtime = false, limit = 0, count = 0, source = ""}

-- raised at every further instruction, so that no pcall of the script gets away with it
local function expire_again()
    if not state.running then debug.sethook() return end
    error("Exceeded CPU time", 0)
end
local function expire()
    state.overtime = true
    debug.sethook(expire_again, "", 1)
    error("Exceeded CPU time", 0)
end
local function count()
    if not state.running then debug.sethook() return end
    if debug.getinfo(2, "S").source == state.source then state.count = state.count + 1 end
    if state.count > state.limit then expire() end
end
local function bounded()
    if not state.running then debug.sethook() return end
    expire()
end

local function arm(limit, source, counting)
    state.limit, state.source, state.overtime, state.count = limit, source, false, 0
    state.running = true
    if counting then debug.sethook(count, "", 1) else debug.sethook(bounded, "", limit) end
end

local function compile(text, source)
    local scope = {}
    for k, v in pairs(env) do scope[k] = v end
    return load(text, source, "t", scope)
end

return state, arm, compile
"""
