-- SPDX-License-Identifier: GPL-3.0-or-later
--
-- Handover guard: no authority, no flight.
--
-- A companion computer decides which ground control station commands this vehicle and tells the autopilot so five
-- times a second, in a "lease". This script watches the lease. Without a live one the vehicle does not arm; in flight
-- it returns home, even when every computer above the flight controller has died. See handover_guard.md.
--
-- How to use
--   1. copy this file to the scripts directory of the autopilot's SD card (APM/scripts)
--   2. load handover.parm (ArduPlane: handover_plane.parm), set HNDO_CHAN to the port of the companion, reboot
--   3. start the companion; "HNDO: lease live" appears and the vehicle can be armed
--
-- If other devices can write to the companion's port, put a key beside this file, see handover_guard.md.
--
-- How to test in SITL
--   1. copy this file to "scripts" in the working directory of the simulation, load handover.parm
--   2. arm: refused ("HNDO: no lease from companion"); start the companion on SERIAL1 (tcp 5762); arm: accepted
--   3. fly in GUIDED, stop the companion: RTL after HNDO_TIMEOUT (a QuadPlane that hovers: QRTL)
--
-- CAUTION: needs firmware 4.5 or later. Run no second script that receives MAVLink: all scripts share one receive
-- queue, so the other script would take leases away from this one.
--
-- Numbers: Lua integers have 32 bits on the autopilot and 64 on a desktop. Everything that comes from the wire or the
-- clock is masked to 32 bits and compared by serial_ahead() or elapsed(), which are right in both.
--
-- Order of this file: constants, one row for each kind of vehicle, parameters, state, authority (update_state), arming,
-- what the vehicle does (observe, classify), responses, the table of transitions (enforce), leases, commands and the
-- receive queue, status and log, the main loop (update, at the end).

-- ArduPilot's Lua allows 100 local variables in a function, and this file is one function. Constants, state and the
-- functions of one subject (`lease`, `key`, `gcs_id`, ...) are therefore fields of tables.

local MAV_SEVERITY = {EMERGENCY=0, ALERT=1, CRITICAL=2, ERROR=3, WARNING=4, NOTICE=5, INFO=6, DEBUG=7}

local TEXT = {
    VERSION = "0.3",
    PREFIX = "HNDO: ",
    BYTES = 50,                     -- one STATUSTEXT
    AUTH_BYTES = 41,                -- longest reason that the arming check shows
    FAULT = "guard fault, see messages",
    TWO_GUARDS = "two guards run, remove one script",
    RESTARTED = "scripting restarted, reboot",
}

local MS = {
    UPDATE = 50,                    -- period of the main loop: an expired lease is noticed within this time
    BUSY = 10,                      -- period while the receive queue is not empty
    STALL = 500,                    -- a call later than this means that this script was stalled, not the companion
    STATUS = 500,                   -- period of the status message to the companion
    HELLO = 100,                    -- period of the status to a companion that does not know the nonce of this guard
    ASKED = 1000,                   -- such a companion was heard within this time
    SETTLE = 2000,                  -- after a new nonce, leases with the former one are expected for this long
    SECOND = 1000,                  -- period of registrations, ids, log and retries
    LANDED = 3000,                  -- after a flight, time on the ground before the motors are stopped
    TAMPER_HOLD = 10000,            -- no arming for this long after the registrations were wiped
    FAULT = 10000,                  -- no arming for this long after an error of this script
    BOOT = 60000,                   -- a script that starts later than this was restarted without the autopilot
    AUX = 1000,                     -- after a DO_AUX_FUNCTION or a full queue, no mode counts as the pilot's
    RADIO = 2000,                   -- a pilot whose radio has been lost for this long does not fly any more
    FAILSAFE = 10000,               -- limit for a failsafe that holds, for a take-off, and after traffic avoidance
    SEQUENCE = 1000,                -- after a change to AUTO the mission item may still be the former one
    TYPE = 60000,                   -- an unknown vehicle type is reported again
}

-- Limits of the work in one call. The firmware removes a script that uses more than 10000 VM instructions in a call,
-- and pcall does not help. A frame costs about 60 instructions, a CRC up to 1000, the tag of a lease another 1000.
local WORK = {
    QUEUE_FRAMES = 25,              -- length of the receive queue
    FRAMES_PER_CALL = 12,
    SUMS_PER_CALL = 3,              -- CRCs and tags; the frame that reaches the limit is still read completely
    COMMANDS_A_SECOND = 10,         -- of one kind; further ones are neither checked nor answered
    CATCH_UP_CALLS = 13,            -- after a stall: calls that empty a full queue before the lease is judged (0.15 s)
    READ_ON_CALLS = 6,              -- calls that read the queue to its end before a pilot is believed (0.06 s)
}

-- what the guard has done in this loss, as the status reports it
local ACTION = {NONE=0, RTL=1, SMART_RTL=2, LAND=3, DISARM=4}
-- reasons of a mode that mean the same on every vehicle (ModeReason of the firmware)
local REASON = {EKF=6, AVOIDANCE=14, AVOIDANCE_RECOVERY=15}

-- One row for each kind of vehicle: what the firmware's numbers mean. The key is FWVersion:type(). The companion's
-- profile of the same kind (vehicle/profiles/) has the same numbers; a test compares the two. "Reason": ModeReason of
-- the firmware.
--   radio_failsafe  name of the parameter that switches the radio failsafe on
--   auto            mode that flies the mission
--   rtl             plain return, for last_resort()
--   returns         modes that return, with their names
--   landings        modes that land, with their names
--   manual          modes in which a pilot steers by hand
--   pilots          reasons: the pilot chose the mode. DO_AUX_FUNCTION has the reason 53 as well (4.5: 1)
--   failsafes       reasons: a failsafe of the autopilot chose the mode
--   commands        reasons: a command or a script chose the mode, with their names
--   sequences       reasons: the autopilot itself moved the mission to its landing sequence
--   resumed         reasons: a failsafe is over and the autopilot restored the former mode
--   ladder          for each HNDO_ACTION the modes to try in flight, in order. The last rung is repeated.
--                     mode, name: of the rung; action: its number in the status; wait_ms: pause after a refusal.
--                     A refused mode costs a STATUSTEXT, an error in the log and a buzzer: that is why there are pauses
--   hover           the same for a QuadPlane in a VTOL mode; absent on vehicles that have none
--   lacks           for each HNDO_ACTION that the vehicle does not have, the text that says so
--   guesses         true: the firmware only estimates whether it flies, and does not tell a script its EKF's health
local VEHICLES = {}
do
    local function set(...)
        local members = {}
        for _, number in ipairs({...}) do
            members[number] = true
        end
        return members
    end

    -- FWVersion:type()
    local COPTER, PLANE = 2, 3

    local orders = {[2]="command", [32]="script", [52]="DDS command"}

    local rtl_1 = {mode=6, name="RTL", action=ACTION.RTL, wait_ms=1000}
    local rtl_2 = {mode=6, name="RTL", action=ACTION.RTL, wait_ms=2000}
    local rtl_3 = {mode=6, name="RTL", action=ACTION.RTL, wait_ms=0}
    local smart = {mode=21, name="SMART_RTL", action=ACTION.SMART_RTL, wait_ms=0}
    local land = {mode=9, name="LAND", action=ACTION.LAND, wait_ms=2000}
    -- ArduCopter. A helicopter (13) has the same numbers, but is not supported: the guard could end its AUTOROTATE.
    VEHICLES[COPTER] = {
        radio_failsafe = "FS_THR_ENABLE",
        auto = 3,
        rtl = 6,
        returns = {[6]="RTL", [21]="SMART_RTL", [27]="AUTO_RTL"},
        landings = {[9]="LAND"},
        -- STABILIZE ACRO ALT_HOLD LOITER DRIFT SPORT FLIP AUTOTUNE POSHOLD FLOWHOLD SYSTEMID
        manual = set(0, 1, 2, 5, 11, 13, 14, 15, 16, 22, 25),
        -- RC switch, throttle escape, toy, RC telemetry, RC auxiliary switch
        pilots = set(1, 9, 18, 42, 53),
        -- radio, battery, GCS, EKF, GPS glitch, fence, terrain, avoidance, termination, crash, general, dead reckoning
        failsafes = set(3, 4, 5, 6, 7, 10, 11, 14, 17, 19, 25, 50),
        commands = orders,
        sequences = {},
        resumed = {},
        ladder = {
            [ACTION.RTL] = {rtl_1, rtl_2, rtl_3, land},
            [ACTION.SMART_RTL] = {smart, rtl_1, rtl_2, rtl_3, land},
            [ACTION.LAND] = {land},
        },
        lacks = {},
        guesses = false,
    }

    -- RTL is repeated without end, because an aircraft on wings cannot land in place. QRTL climbs first, then returns.
    local home = {{mode=11, name="RTL", action=ACTION.RTL, wait_ms=1000},
                  {mode=11, name="RTL", action=ACTION.RTL, wait_ms=2000}}
    local qland = {mode=20, name="QLAND", action=ACTION.LAND, wait_ms=2000}
    local qhome = {{mode=21, name="QRTL", action=ACTION.RTL, wait_ms=1000},
                   {mode=21, name="QRTL", action=ACTION.RTL, wait_ms=2000},
                   {mode=21, name="QRTL", action=ACTION.RTL, wait_ms=0}, qland}
    -- ArduPlane, QuadPlanes included
    VEHICLES[PLANE] = {
        radio_failsafe = "THR_FAILSAFE",
        auto = 10,
        rtl = 11,
        returns = {[11]="RTL", [21]="QRTL"},
        landings = {[20]="QLAND", [25]="LOITER_ALT_QLAND", [26]="AUTOLAND"},
        -- MANUAL STABILIZE TRAINING ACRO FBWA FBWB CRUISE AUTOTUNE QSTABILIZE QHOVER QLOITER QAUTOTUNE QACRO
        manual = set(0, 2, 3, 4, 5, 6, 7, 8, 17, 18, 19, 22, 23),
        -- RC switch, RC telemetry, RC auxiliary switch
        pilots = set(1, 42, 53),
        -- those of ArduCopter; VTOL transition failed, VTOL take-off failed, radio or GCS lost in the mode TAKEOFF
        failsafes = set(3, 4, 5, 6, 7, 10, 11, 14, 17, 19, 23, 24, 25, 50, 51),
        commands = orders,
        -- battery, RTL that has arrived (RTL_AUTOLAND)
        sequences = set(4, 40),
        -- fence, radio
        resumed = set(43, 48),
        ladder = {[ACTION.RTL]=home, [ACTION.SMART_RTL]=home, [ACTION.LAND]=home},
        hover = {[ACTION.RTL]=qhome, [ACTION.SMART_RTL]=qhome, [ACTION.LAND]={qland}},
        lacks = {[ACTION.SMART_RTL]="no SmartRTL here, HNDO_ACTION 2 is RTL"},
        guesses = true,
    }
end

-- Names of vehicle types that are not supported: they do not arm.
local OTHERS = {[1]="Rover", [4]="Tracker", [7]="Sub", [12]="Blimp", [13]="Heli"}

local MAV = {
    TUNNEL = 385,
    COMMAND_LONG = 76,
    COMMAND_INT = 75,
    COMMAND_ACK = 77,
    CRC_EXTRA = {[385]=147, [76]=152, [75]=158},
    CMD_SCRIPTING = 42701,
    CMD_AUX_FUNCTION = 218,
    RESULT_ACCEPTED = 0, RESULT_DENIED = 2, RESULT_FAILED = 4,
    AUTOPILOT_COMPID = 1,
    MAGIC_2 = 0xFD,
    TUNNEL_BYTES = 133,
    TUNNEL_HEAD_BYTES = 5,          -- payload_type, target_system, target_component, payload_length
}

-- The lease (companion to guard), the status (guard to companion), and the state of the lease, a field of the status.
local LEASE = {TYPE=47116, BYTES=24, VERSION=2, HELD=1, TRANSFER=2, LOST=3, RECOVERING=4, ALONE=5, TAG_BYTES=8,
               TAGGED=1, TWO_GUARDS=2}
local STATUS = {TYPE=47117, BYTES=24, VERSION=2, ENFORCING=1, ARMED=2, FLYING=4, TAMPERED=8, UNKNOWN_VEHICLE=16,
                TAGGED=32, SECOND=64}
local STATE = {DISABLED=0, WAITING=1, LIVE=2, EXPIRED=3, LOST=4}

-- ------------------------------------------------------------------------------------------------ parameters

local PARAM_TABLE_KEY = 147
local HNDO = {PREFIX="HNDO_"}
assert(param:add_table(PARAM_TABLE_KEY, HNDO.PREFIX, 8), "HNDO: could not add param table")

local function bind_add_param(name, idx, default_value)
    assert(param:add_param(PARAM_TABLE_KEY, idx, name, default_value), "HNDO: could not add param " .. name)
    return Parameter(HNDO.PREFIX .. name)
end

--[[
  // @Param: HNDO_ENABLE
  // @DisplayName: Handover guard enable
  // @Description: Without a live authority lease from the companion computer the vehicle does not arm and returns from flight. 0 ends all supervision at once.
  // @Values: 0:Disabled,1:Enabled
  // @User: Standard
--]]
HNDO.ENABLE = bind_add_param("ENABLE", 1, 1)

--[[
  // @Param: HNDO_TIMEOUT
  // @DisplayName: Handover lease timeout
  // @Description: Time without a lease after which it counts as lost. A lease that names a shorter life of its own dies sooner. Keep FS_GCS_TIMEOUT (ArduPlane: FS_LONG_TIMEOUT) longer.
  // @Range: 1 30
  // @Units: s
  // @User: Standard
--]]
HNDO.TIMEOUT = bind_add_param("TIMEOUT", 2, 3)

--[[
  // @Param: HNDO_LOST_T
  // @DisplayName: Handover lost time
  // @Description: Time that live leases may say that no station has authority before the vehicle is sent home. The companion, which sends them, is expected to act first. Keep it longer than the companion tries a forced transfer (forced_timeout_s, 2 s), and half a second longer than it waits for the commander after a restart (recovery_s, 2.5 s).
  // @Range: 0 60
  // @Units: s
  // @User: Standard
--]]
HNDO.LOST_T = bind_add_param("LOST_T", 3, 3)

--[[
  // @Param: HNDO_ACTION
  // @DisplayName: Handover guard action
  // @Description: What is done in flight when authority is lost. ArduCopter: if the mode is refused, SMART_RTL falls back to RTL, RTL to LAND. ArduPlane: 1 and 2 are RTL, in hover QRTL; 3 is QLAND in hover and RTL on wings, which lands if RTL_AUTOLAND says so.
  // @Values: 1:RTL,2:SmartRTL,3:Land
  // @User: Standard
--]]
HNDO.ACTION = bind_add_param("ACTION", 4, 1)

--[[
  // @Param: HNDO_CHAN
  // @DisplayName: Handover companion channel
  // @Description: MAVLink channel the companion is wired to, counted over the ports that speak MAVLink: on a Cube Orange 0 is USB, 1 TELEM1, 2 TELEM2. Leases from other channels are refused. -1 takes the first channel that brings a good lease. The guard answers only where it has heard something.
  // @Range: -1 15
  // @User: Standard
--]]
HNDO.CHAN = bind_add_param("CHAN", 5, 1)

--[[
  // @Param: HNDO_COMPID
  // @DisplayName: Handover companion component id
  // @Description: MAVLink component id of the companion. Its system id is the vehicle's.
  // @Range: 1 255
  // @User: Advanced
--]]
HNDO.COMPID = bind_add_param("COMPID", 6, 191)

--[[
  // @Param: HNDO_SYSID_SW
  // @DisplayName: Handover GCS id switching
  // @Description: The autopilot's GCS id (MAV_GCS_SYSID, SYSID_MYGCS) follows the commander. It is changed in RAM only and reverts at a reboot.
  // @Values: 0:Disabled,1:Enabled
  // @User: Standard
--]]
HNDO.SYSID_SW = bind_add_param("SYSID_SW", 7, 1)

--[[
  // @Param: HNDO_ALONE_MAX
  // @DisplayName: Handover longest time alone
  // @Description: Time that the vehicle may fly on without a commander at the most, where its mission declares a gap in coverage. Counted from the first lease of a loss that says so. 0: it never does. Keep it no longer than the longest gap of your missions needs.
  // @Range: 0 600
  // @Units: s
  // @User: Standard
--]]
HNDO.ALONE_MAX = bind_add_param("ALONE_MAX", 8, 0)

-- ------------------------------------------------------------------------------------------------ state

local config = {enable=true, timeout_ms=3000, lost_ms=1000, action=ACTION.RTL, chan=1, compid=191, sysid_sw=true,
                alone_ms=0}
-- The last accepted lease. live: not expired; at: when it was received; ttl_ms: life that it states for itself;
-- retired: nonces of former companions, newest last; two_guards: the companion hears two guards; alone_at: time of the
-- first lease with ALONE since a station last commanded; alone_ms: how long that lease allowed
local lease = {seen=false, live=false, nonce=0, sequence=0, epoch=0, state=0, commander=0, ttl_ms=0, at=0, chan=-1,
               retired={}, two_guards=false, alone_at=nil, alone_ms=0}
-- Leases that were refused. text: reason of the last one, until a lease is accepted
local refused = {count=0, text=nil}
-- The nonce of this guard, which each lease must carry (see this_guard.draw_nonce); never 0 once drawn. told: a status
-- with it was sent; asked_at, chan: when and where a companion was last heard that does not know it
local this_guard = {nonce=0, told=false, changed_at=nil, asked_at=nil, chan=-1}
local state = STATE.WAITING
local tampering = {seen=false, at=nil}

-- The autopilot. known: VEHICLES has a row for its type; name: of its type, for messages; radio_failsafe: the parameter
-- object, nil if the firmware has no such parameter
local autopilot = {sysid=1, type=nil, known=false, name="", major=0, minor=0, radio_failsafe=nil}
pcall(function()
    autopilot.major, autopilot.minor = FWVersion:major(), FWVersion:minor()
    autopilot.type = FWVersion:type()
end)
-- the row of this vehicle; an unknown type has an empty row
local firmware = VEHICLES[autopilot.type] or {returns={}, landings={}, manual={}, pilots={}, failsafes={}, commands={},
                                              sequences={}, resumed={}, lacks={}}
autopilot.known = VEHICLES[autopilot.type] ~= nil
autopilot.name = OTHERS[autopilot.type] or "vehicle type " .. tostring(autopilot.type or "?")
if autopilot.known then
    local there, parameter = pcall(Parameter, firmware.radio_failsafe)
    autopilot.radio_failsafe = there and parameter or nil
end

-- The receive queue and the commands that were read from it.
--   ids             message ids that are registered
--   heard           channels that a frame has come from
--   in_a_row        frames read since the queue was last empty
--   drained         the queue has been read to its end since the mode last changed
--   full_at         when the queue was full, so that frames may have been lost
--   aux_at, aux_by  when and from which sender a DO_AUX_FUNCTION came that the autopilot may have executed
--   aux_ours_at     since when the firmware leaves DO_AUX_FUNCTION to this script
--   own_table       this script has created the table of ids, with room for all of them
--   no_commands     the table of ids belongs to another script and has no room for commands
--   second_guard    another guard started before this one
--   restarted       scripting was restarted, the autopilot was not
--   commands        commands of each kind in this second
--   sums            CRCs and tags computed in this call
--   read_less       the last call had no instructions left for a status with a tag: this call reads less
local rx = {ids={MAV.TUNNEL, MAV.COMMAND_LONG, MAV.COMMAND_INT}, heard={}, in_a_row=0, drained=false, full_at=nil,
            aux_at=nil, aux_by="", aux_ours_at=nil, own_table=false, second_guard=false, restarted=false,
            no_commands=false, commands={}, sums=0, read_less=false}

local function clock()
    return millis():toint()
end

-- Milliseconds since an instant. 0 if it lies ahead: a frame may come in, and be stamped, while this call runs.
local function elapsed(now, instant)
    local d = (now - instant) & 0xFFFFFFFF
    if d < 0 or d > 0x7FFFFFFF then
        return 0
    end
    return d
end

-- whether counter a is newer than b, both modulo 2^32
local function serial_ahead(a, b)
    local d = (a - b) & 0xFFFFFFFF
    return d > 0 and d <= 0x7FFFFFFF
end

-- Times of events (ms). start: of this script, or of the last change of HNDO_ENABLE; lost: state became LOST; last_run,
-- status, second, last_resort: last time that each was done; said: last time of each kind of text
local since = {said={}}
since.start = clock()
since.last_run, since.status, since.second, since.lost = since.start, since.start, since.start, since.start
-- This script. grace_over: HNDO_TIMEOUT is over in which the companion may appear after the start; catch_up: calls left
-- that only read the queue; late: the last call came after a stall; fault_at: time of the last error of this script
local running = {grace_over=false, catch_up=0, late=false, fault_at=nil}

local ENFORCEMENT = {CALM=0, MISSING=1, ORDERING=2, RETURNING=3, LANDING=4, PILOT=5, FAILSAFE=6}
local SEEN = {AUTHORITY=1, DISARMED=2, GROUND=3, RETURN=4, LANDING=5, LAND_ORDER=6, TOLERATED=7, OVERDUE=8, HOLDING=9,
              UNDECIDED=10, MANUAL=11, PILOT_CHOICE=12, OTHER=13}

local enforcement = ENFORCEMENT.CALM
-- The vehicle, as observe() last saw it.
--   flown, flown_at          it has flown since it was armed; when last
--   disarm_tried, disarm_at  the guard has tried to disarm it since it was armed; when last
--   mode, reason             the mode and the firmware's reason for it
--   changes                  how often mode or reason have changed
--   at                       time of the last observation
--   former_at                time of the last observation of the former mode: the change came after it
--   reads_left               calls left that read the queue before the mode is attributed; 0: it is attributed
--   by_pilot, why_not        the mode is attributed to the pilot; if not, the text that says why
--   radio_watched            the radio failsafe is on. If it is off, the firmware may call a dead radio valid
--   radio_valid, radio_at    the radio is watched and valid; when last
--   avoided_at               time of the last traffic avoidance, if less than 10 s ago
--   pilot_mode               the mode last attributed to the pilot; kept while only failsafes change the mode
--   item, strayed            item of the landing sequence; the mission was set back to an earlier item
local craft = {armed=false, flying=false, flown=false, flown_at=0, disarm_tried=false, disarm_at=0, mode=nil,
               reason=nil, changes=0, at=since.start, former_at=since.start, reads_left=0, by_pilot=false, why_not="",
               radio_watched=false, radio_valid=false, radio_at=since.start, avoided_at=nil, pilot_mode=nil, item=nil,
               strayed=false}

-- The present loss of authority. action: for the status; mode, since: the mode that the guard has set or accepted, and
-- when; changes: craft.changes when it first acted; attempts: rung of the ladder; tried_at, wait_ms: last try, pause
-- after it; climbing: the guard stands back for a take-off; last_resort: see last_resort()
local loss = {action=ACTION.NONE, mode=nil, since=0, changes=0, attempts=0, wait_ms=0, tried_at=0, climbing=false,
              last_resort=false}

-- Sends a text to the stations, at most one of a kind in gap_ms.
local function say(severity, kind, gap_ms, text)
    local now = clock()
    local before = since.said[kind]
    local ago = before and (now - before) & 0xFFFFFFFF
    if ago and ago >= 0 and ago < gap_ms then       -- negative with 32 bits: 24.8 days and more
        return
    end
    since.said[kind] = now
    gcs:send_text(severity, string.sub(TEXT.PREFIX .. text, 1, TEXT.BYTES))
end

local function notice_tampering(now, text)
    tampering.seen = true
    tampering.at = now
    say(MAV_SEVERITY.WARNING, "tamper", 10000, text)
end

-- The value of a parameter, limited to its range. A value that cannot be read counts as the lowest one.
local function clamped(parameter, low, high)
    local v = parameter:get()
    if not v or v ~= v or v < low then
        return low
    end
    if v > high then
        return high
    end
    return v
end

function config.read(now)
    local enable = clamped(HNDO.ENABLE, 0, 1) >= 0.5
    if enable ~= config.enable then
        config.enable = enable
        since.start, running.grace_over = now, false
        if not enable then
            say(MAV_SEVERITY.WARNING, "disabled", 2000, "guard disabled")
        end
    end
    config.timeout_ms = math.floor(clamped(HNDO.TIMEOUT, 1, 30) * 1000)
    config.lost_ms = math.floor(clamped(HNDO.LOST_T, 0, 60) * 1000)
    local action = math.floor(clamped(HNDO.ACTION, ACTION.RTL, ACTION.LAND))
    if action ~= config.action and firmware.lacks[action] then
        say(MAV_SEVERITY.NOTICE, "action", 2000, firmware.lacks[action])
    end
    config.action = action
    config.chan = math.floor(clamped(HNDO.CHAN, -1, 15))
    config.compid = math.floor(clamped(HNDO.COMPID, 1, 255))
    config.sysid_sw = clamped(HNDO.SYSID_SW, 0, 1) >= 0.5
    config.alone_ms = math.floor(clamped(HNDO.ALONE_MAX, 0, 600) * 1000)
end

-- ------------------------------------------------------------------------------------------------ authority

-- True while the vehicle may fly on without a commander. The first lease with ALONE sets the time, later ones do not
-- extend it. Only in flight, and not after the guard has begun to act on the loss.
function lease.alone(now)
    return craft.flying and enforcement == ENFORCEMENT.CALM and
        elapsed(now, lease.alone_at) < math.min(lease.alone_ms, config.alone_ms)
end

-- Sets `state` by the last lease and its age.
local function update_state(now)
    if lease.live and elapsed(now, lease.at) >= math.min(config.timeout_ms, lease.ttl_ms) then
        lease.live = false          -- it stays so until a new lease is accepted
    end
    if not running.grace_over and elapsed(now, since.start) >= config.timeout_ms then
        running.grace_over = true
    end
    local before = state
    if not config.enable then
        state = STATE.DISABLED
    elseif not lease.seen then
        state = STATE.WAITING
    elseif not lease.live then
        state = STATE.EXPIRED
    elseif lease.state == LEASE.LOST or lease.commander == 0 then   -- no commander means LOST in every state
        state = STATE.LOST
    elseif lease.state == LEASE.ALONE and not lease.alone(now) then
        state = STATE.LOST
    else
        state = STATE.LIVE
    end
    if state == STATE.LOST and before ~= STATE.LOST then
        since.lost = now
    end
end

-- The reason against arming, nil if there is none.
local function arming_objection(now)
    if state == STATE.DISABLED then
        return nil
    end
    if not autopilot.known then
        return autopilot.name .. " not supported"
    end
    if rx.no_commands then
        return "MAVLink rx taken by a script"
    end
    if running.fault_at and elapsed(now, running.fault_at) < MS.FAULT then
        return TEXT.FAULT           -- the part that fails may be the part that would bring the vehicle home
    end
    running.fault_at = nil
    if craft.armed then             -- see permit_arming
        return "guard stopped while armed"
    end
    if tampering.at and elapsed(now, tampering.at) < MS.TAMPER_HOLD then
        return "another script tampers"
    end
    tampering.at = nil
    if rx.second_guard or (lease.live and lease.two_guards) then
        return TEXT.TWO_GUARDS
    end
    if rx.restarted then
        return TEXT.RESTARTED
    end
    if state == STATE.LIVE then
        if lease.state == LEASE.HELD or lease.state == LEASE.TRANSFER then
            return nil
        end
        return "authority is being recovered"
    end
    if state == STATE.LOST then
        return "no station has authority"
    end
    if refused.text then
        return refused.text
    end
    if state == STATE.EXPIRED then
        return "lease lost"
    end
    return "no lease from companion"
end

local auth_id = arming:get_aux_auth_id()
if not auth_id then                 -- too many scripts want one: the firmware itself refuses arming then
    say(MAV_SEVERITY.ERROR, "auth", 0, "no arming authorisation available")
end

-- Tells the firmware whether the vehicle may arm. The firmware keeps the last answer of a script that has died. So the
-- guard withdraws its authorisation while the motors run, when the firmware does not ask for it. If the script dies in
-- flight, the vehicle does not arm again.
local function permit_arming(now)
    if not auth_id then
        return
    end
    local objection = arming_objection(now)
    if objection then
        arming:set_aux_auth_failed(auth_id, string.sub(TEXT.PREFIX .. objection, 1, TEXT.AUTH_BYTES))
    else
        arming:set_aux_auth_passed(auth_id)
    end
end

-- --------------------------------------------------------------------------------------- what the vehicle does

--[[
Theory of operation

Each call observes the vehicle once (observe) and classifies it as one of SEEN (classify). Then it takes one step of
TRANSITIONS: the state of enforcement and the class give the next state and the response (RESPONSE). Nothing else
changes the state of enforcement. A missing entry of the table is a fault of this script; the guard then orders the way
home.

"The loss" is the time in which authority is missing. "The way home" is the mode that HNDO_ACTION names (ladder, hover).

  state       authority  the guard
  CALM        is there   does nothing
  MISSING     missing    has not seen the vehicle fly in this loss: it stays disarmed or is disarmed
  ORDERING    missing    orders the way home; after a refusal it pauses and orders again
  RETURNING   missing    watches a return, from any source
  LANDING     missing    watches a landing: a mode that lands, or AUTO while it descends at a landing item
  PILOT       missing    stands back for a pilot with a valid radio
  FAILSAFE    missing    stands back for a failsafe that holds the vehicle: 10 s, longer with a failed EKF; for traffic
                         avoidance and 10 s after it; for the take-off of an aircraft with wings, at most 10 s

  SEEN, the first that fits
  AUTHORITY     authority is there, or the guard is switched off
  DISARMED      the motors are off
  GROUND        armed, not flying
  RETURN        a mode that returns, or AUTO in a landing sequence that the autopilot has chosen
  LANDING       a landing that is allowed, or that the guard has set or accepted before
  LAND_ORDER    a landing by a command while the companion does not say LOST, or by a switch that is not believed; CALM
                and MISSING accept it, because it was ordered before the loss
  TOLERATED     the mode that the guard stands back for, within PATIENCE
  OVERDUE       the same mode, after PATIENCE is over
  HOLDING       a failsafe's mode that neither returns nor lands, or a take-off under way when the loss began
  UNDECIDED     a mode with a pilot's reason; the queue may still hold the DO_AUX_FUNCTION that chose it
  MANUAL        a pilot steers by hand
  PILOT_CHOICE  any other mode that a pilot has chosen since the loss
  OTHER         everything else: a station, a script, DO_AUX_FUNCTION, a switch without a radio failsafe
--]]
-- True if authority is missing, and the time for which it may be missing is over.
local function authority_missing(now)
    if state == STATE.WAITING or state == STATE.EXPIRED then
        return running.grace_over
    end
    if state == STATE.LOST then     -- after an expired lease, a lease that says LOST does not end the loss
        return enforcement ~= ENFORCEMENT.CALM or elapsed(now, since.lost) >= config.lost_ms
    end
    return false
end

-- True if the reason of a mode allows that the pilot chose it. A firmware that tells no reason allows it, too.
local function may_be_pilots(reason)
    return reason == nil or firmware.pilots[reason]
end

-- Decides whether the pilot chose the present mode. Not if a DO_AUX_FUNCTION came up to a second before the mode was
-- seen, or may have been lost because the queue was full. A command that the firmware leaves to this script changes no
-- mode if it is lost. From then on a flood cannot keep a pilot from the aircraft.
local function attribute_mode()
    local aux_ours = rx.aux_ours_at and elapsed(craft.former_at, rx.aux_ours_at) >= MS.AUX
    if rx.no_commands then
        craft.why_not = "switch undone, rx taken"
    elseif rx.aux_at and elapsed(craft.former_at, rx.aux_at) < MS.AUX then
        craft.why_not = "DO_AUX of " .. rx.aux_by .. " undone"
    elseif not aux_ours and (not rx.drained or (rx.full_at and elapsed(craft.former_at, rx.full_at) < MS.AUX)) then
        craft.why_not = "switch undone, rx flooded"
    else
        craft.by_pilot, craft.pilot_mode = true, craft.mode
    end
    craft.reads_left = 0
end

local function is_hovering()
    return firmware.hover ~= nil and quadplane ~= nil and quadplane:in_vtol_mode()
end

-- True in a take-off on wings, from the roll to its height: a turn towards home near the ground is dangerous.
local function is_climbing_out()
    return firmware.guesses and vehicle.is_taking_off ~= nil and vehicle:is_taking_off() and not is_hovering()
end

-- A landing sequence counts as the autopilot's until a command sets the mission back to an earlier item.
local function follow_sequence(now)
    local item = mission ~= nil and mission:get_current_nav_index() or 0
    if craft.item and item < craft.item then
        craft.strayed = true
    end
    if elapsed(now, craft.former_at) >= MS.SEQUENCE then
        craft.item = item
    end
end

-- Reads the vehicle into `craft`.
local function observe(now)
    craft.armed = arming:is_armed()
    craft.flying = craft.armed and vehicle:get_likely_flying()
    if not craft.armed then
        craft.flown, craft.disarm_tried = false, false
    elseif craft.flying then
        craft.flown, craft.flown_at = true, now
    end
    craft.radio_watched = autopilot.radio_failsafe ~= nil and (autopilot.radio_failsafe:get() or 0) > 0
    craft.radio_valid = craft.radio_watched and rc ~= nil and rc:has_valid_input()
    if craft.radio_valid then
        craft.radio_at = now
    end
    local mode, reason = vehicle:get_mode(), nil
    if vehicle.get_control_mode_reason then
        reason = vehicle:get_control_mode_reason()
    end
    local judging = craft.reads_left > 0
    if judging then
        craft.reads_left = craft.reads_left - 1
    end
    if mode ~= craft.mode or reason ~= craft.reason then
        craft.mode, craft.reason, craft.changes, craft.former_at = mode, reason, craft.changes + 1, craft.at
        -- after a failsafe the autopilot restores the mode that the pilot had
        craft.by_pilot = firmware.resumed[reason] and firmware.manual[mode] and mode == craft.pilot_mode
        rx.drained = false
        if not (firmware.resumed[reason] or firmware.failsafes[reason]) then
            craft.pilot_mode = nil
        end
        craft.item, craft.strayed = nil, false
        if not may_be_pilots(reason) then
            craft.reads_left, judging = 0, false
        elseif not judging then     -- repeated changes do not extend the time
            craft.reads_left = WORK.READ_ON_CALLS
        end
    end
    if judging and (rx.drained or craft.reads_left == 0) then
        attribute_mode()
    end
    if mode == firmware.auto and firmware.sequences[reason] then
        follow_sequence(now)
    end
    if reason == REASON.AVOIDANCE then
        craft.avoided_at = now
    elseif craft.avoided_at and elapsed(now, craft.avoided_at) >= MS.FAILSAFE then
        craft.avoided_at = nil
    end
    craft.at = now
end

-- for each state in which the guard stands back: true while it may go on
local PATIENCE = {
    [ENFORCEMENT.PILOT] = function(now)
        return elapsed(now, craft.radio_at) < MS.RADIO
    end,
    [ENFORCEMENT.FAILSAFE] = function(now)
        if loss.climbing and not is_climbing_out() then
            return false
        end
        return elapsed(now, loss.since) < MS.FAILSAFE or craft.avoided_at ~= nil or
            (firmware.guesses and craft.reason == REASON.EKF) or
            (vehicle.has_ekf_failsafed ~= nil and vehicle:has_ekf_failsafed())
    end,
}

-- The class of what observe() has seen: one of SEEN, see the theory of operation.
local function classify(now)
    if not authority_missing(now) then
        return SEEN.AUTHORITY
    end
    if not craft.armed then
        return SEEN.DISARMED
    end
    if not craft.flying then
        return SEEN.GROUND
    end
    local mode, reason, pilot = craft.mode, craft.reason, craft.by_pilot and craft.radio_valid
    if firmware.returns[mode] or (mode == firmware.auto and firmware.sequences[reason] and not craft.strayed) then
        return SEEN.RETURN
    end
    if firmware.landings[mode] or (mode == firmware.auto and vehicle.is_landing and vehicle:is_landing()) then
        if mode == loss.mode then
            return SEEN.LANDING
        end
        if may_be_pilots(reason) then
            return craft.reads_left > 0 and SEEN.UNDECIDED or pilot and SEEN.LANDING or SEEN.LAND_ORDER
        end
        return firmware.commands[reason] and state ~= STATE.LOST and SEEN.LAND_ORDER or SEEN.LANDING
    end
    if mode == loss.mode then       -- not its reason: the firmware overwrites it when the same mode is ordered again
        local patience = PATIENCE[enforcement]
        return patience and patience(now) and SEEN.TOLERATED or SEEN.OVERDUE
    end
    if firmware.failsafes[reason] or (reason == REASON.AVOIDANCE_RECOVERY and craft.avoided_at) then
        return SEEN.HOLDING
    end
    if enforcement <= ENFORCEMENT.MISSING and is_climbing_out() then
        return SEEN.HOLDING
    end
    if may_be_pilots(reason) and craft.reads_left > 0 then
        return SEEN.UNDECIDED
    end
    if pilot and firmware.manual[mode] then
        return SEEN.MANUAL
    end
    return pilot and craft.changes ~= loss.changes and SEEN.PILOT_CHOICE or SEEN.OTHER
end

-- ------------------------------------------------------------------------------------------------ responses

-- what the guard does in a step; each returns true if it has set a mode
local RESPONSE = {}

local function loss_name()
    if state == STATE.LOST then
        return "no authority"
    end
    return lease.seen and "lease lost" or "no lease"
end

local function mode_name(mode)
    return firmware.returns[mode] or firmware.landings[mode] or "AUTO, landing"
end

-- Leaves the vehicle in the mode that it has, and says so once.
local function accept_mode(now, text)
    if loss.mode ~= craft.mode then
        say(MAV_SEVERITY.NOTICE, "settle", 2000, loss_name() .. ", " .. text)
        loss.mode, loss.since = craft.mode, now
    end
    loss.attempts = 0
end

-- The source of the mode that is undone, for the message.
local function undone_text()
    if firmware.commands[craft.reason] then
        return firmware.commands[craft.reason] .. " undone"
    end
    if not firmware.pilots[craft.reason] then
        return "mode change undone"
    end
    if not craft.by_pilot then
        return craft.why_not
    end
    return craft.radio_watched and "switch undone, no radio" or "switch undone, " .. firmware.radio_failsafe .. " 0"
end

-- Tries the next rung of the ladder when its pause is over. Returns the rung if the autopilot accepts the mode, else
-- nil.
local function send_home(now)
    if not craft.flying or (loss.attempts > 0 and elapsed(now, loss.tried_at) < loss.wait_ms) then
        return nil
    end
    local ladders = is_hovering() and firmware.hover or firmware.ladder
    local ladder = ladders[config.action]
    local rung = ladder[math.min(loss.attempts + 1, #ladder)]
    loss.attempts = math.min(loss.attempts + 1, #ladder)
    loss.tried_at, loss.wait_ms = now, rung.wait_ms
    if not vehicle:set_mode(rung.mode) then
        say(MAV_SEVERITY.CRITICAL, "refused", 1000, loss_name() .. ", " .. rung.name .. " refused")
        return nil
    end
    loss.mode, loss.action, loss.attempts = rung.mode, rung.action, 0
    return rung
end

function RESPONSE.announce()
    say(MAV_SEVERITY.NOTICE, "loss", 2000, loss_name())
end

function RESPONSE.reset()
    loss.mode, loss.attempts, loss.wait_ms, loss.climbing = nil, 0, 0, false
end

function RESPONSE.end_loss()
    loss.action = ACTION.NONE
    if state == STATE.LIVE and craft.flying then
        local mode = firmware.landings[loss.mode] or firmware.returns[loss.mode]
        say(MAV_SEVERITY.NOTICE, "back", 1000, "authority back" .. (mode and ", staying in " .. mode or ""))
    end
    RESPONSE.reset()
end

-- Stops the motors on the ground. A script's disarm stops them in the air as well, so the guard must be sure that the
-- vehicle is on the ground. An estimate (`guesses`) is not enough once the vehicle has flown.
function RESPONSE.disarm(now)
    if craft.flown and (firmware.guesses or elapsed(now, craft.flown_at) < MS.LANDED) then
        return
    end
    if craft.disarm_tried and elapsed(now, craft.disarm_at) < MS.SECOND then
        return
    end
    craft.disarm_tried, craft.disarm_at = true, now
    if arming:disarm() then
        loss.action = ACTION.DISARM
        say(MAV_SEVERITY.CRITICAL, "disarm", 2000, loss_name() .. ", disarmed")
    end
end

function RESPONSE.watch(now)
    accept_mode(now, "in " .. mode_name(craft.mode))
end

function RESPONSE.stand_back(now)
    if enforcement == ENFORCEMENT.PILOT then
        accept_mode(now, "pilot flies")
    else
        loss.climbing = not firmware.failsafes[craft.reason] and is_climbing_out()
        accept_mode(now, craft.avoided_at and "traffic avoidance" or loss.climbing and "taking off" or "failsafe acts")
    end
end

function RESPONSE.order(now, why)
    local done = send_home(now)
    if done then
        why = loss.climbing and "taken off" or why
        loss.climbing = false
        why = why and ", " .. why or ""
        say(MAV_SEVERITY.CRITICAL, "action", 1000, loss_name() .. why .. ", " .. done.name)
    end
    return done ~= nil
end

function RESPONSE.undo(now)
    local done = send_home(now)
    if done then
        say(MAV_SEVERITY.WARNING, "undone", 2000, loss_name() .. ", " .. undone_text())
    end
    return done ~= nil
end

-- ------------------------------------------------------------------------------------------------ enforcement

-- For each state of enforcement (row) and each of SEEN (column): the next state (`to`; none: it stays), the response,
-- and the reason for its message. Short names keep a row on one line: `calm` and `over` end the loss. `told` announces
-- it. `gone` and `off` disarm. `call` orders the way home; `undo` does so, and names the source of the mode that it
-- undoes.
local TRANSITIONS = {}
do
    local E, R = ENFORCEMENT, RESPONSE
    local calm, told, gone = {to=E.CALM}, {to=E.MISSING, response=R.announce}, {to=E.MISSING, response=R.disarm}
    local over, down = {to=E.CALM, response=R.end_loss}, {to=E.MISSING, response=R.reset}
    local off, stay, miss = {response=R.disarm}, {}, {to=E.MISSING}
    local home, land = {to=E.RETURNING, response=R.watch}, {to=E.LANDING, response=R.watch}
    local hand, fail = {to=E.PILOT, response=R.stand_back}, {to=E.FAILSAFE, response=R.stand_back}
    local call, undo = {to=E.ORDERING, response=R.order}, {to=E.ORDERING, response=R.undo}
    local left = {to=E.ORDERING, response=R.order, why="landing left"}
    local dead = {to=E.ORDERING, response=R.order, why="radio gone"}
    local held = {to=E.ORDERING, response=R.order, why="held 10 s"}
    --                        AUTHORITY  GROUND   LANDING       TOLERATED     HOLDING       MANUAL        OTHER
    --                              DISARMED RETURN  LAND_ORDER       OVERDUE       UNDECIDED     PILOT_CHOICE
    TRANSITIONS[E.CALM] =      {calm, told, gone, home, land, land, call, call, fail, miss, hand, call, call}
    TRANSITIONS[E.MISSING] =   {over, down, off,  home, land, land, call, call, fail, stay, hand, call, call}
    TRANSITIONS[E.ORDERING] =  {over, down, off,  home, land, call, call, call, fail, stay, hand, hand, call}
    TRANSITIONS[E.RETURNING] = {over, down, off,  home, land, undo, call, left, fail, stay, hand, hand, undo}
    TRANSITIONS[E.LANDING] =   {over, down, off,  home, land, land, call, left, fail, stay, hand, hand, undo}
    TRANSITIONS[E.PILOT] =     {over, down, off,  home, land, undo, stay, dead, fail, stay, hand, hand, undo}
    TRANSITIONS[E.FAILSAFE] =  {over, down, off,  home, land, undo, stay, held, fail, stay, hand, hand, undo}
end

-- One step of the table. Returns whether a mode was set.
local function step(now)
    local seen = classify(now)
    local row = TRANSITIONS[enforcement]
    local move = row and row[seen]
    if not move then                -- order the way home; send_home() does nothing on the ground
        say(MAV_SEVERITY.ERROR, "entry", 10000, string.format("fault, no entry %d/%d", enforcement, seen))
        move = {to=ENFORCEMENT.ORDERING, response=RESPONSE.order}
    end
    if enforcement <= ENFORCEMENT.MISSING then
        loss.changes = craft.changes
    end
    enforcement = move.to or enforcement
    return move.response and move.response(now, move.why)
end

local function enforce(now)
    update_state(now)
    observe(now)
    if not autopilot.known then     -- the numbers of its modes are unknown: set none
        return
    end
    if step(now) then               -- observe the mode that was just set: a later change is a change of this one
        observe(now)
        step(now)
    end
    if craft.flying and enforcement ~= ENFORCEMENT.CALM and not rx.aux_ours_at and mavlink.block_command then
        rx.aux_ours_at = mavlink:block_command(MAV.CMD_AUX_FUNCTION) and now or nil
    end
end

-- Replaces enforce() if that raises an error, for example because this firmware lacks a binding: one plain RTL in each
-- loss, ordered every second until it is accepted.
local function last_resort(now)
    update_state(now)
    if not authority_missing(now) then
        loss.last_resort, since.last_resort = false, nil
    elseif not loss.last_resort and autopilot.known and arming:is_armed() and
        (not since.last_resort or elapsed(now, since.last_resort) >= MS.SECOND) then
        since.last_resort = now
        local told, mode = pcall(vehicle.get_mode, vehicle)
        loss.last_resort = told and firmware.returns[mode] ~= nil or vehicle:set_mode(firmware.rtl)
    end
end

-- ------------------------------------------------------------------------------------------------ the lease

-- X.25 checksum as MAVLink uses it. The firmware passes corrupted messages to scripts, so every lease is checked.
local function x25(text, extra)
    local crc = 0xFFFF
    local byte = string.byte
    for i = 1, #text do
        local t = (byte(text, i) ~ crc) & 0xFF
        t = (t ~ (t << 4)) & 0xFF
        crc = (crc >> 8) ~ (t << 8) ~ (t << 3) ~ (t >> 4)
    end
    local t = (extra ~ crc) & 0xFF
    t = (t ~ (t << 4)) & 0xFF
    return ((crc >> 8) ~ (t << 8) ~ (t << 3) ~ (t >> 4)) & 0xFFFF
end

local function crc_fits(msg, magic, len, msgid, crc)
    local covered
    if magic == MAV.MAGIC_2 then
        covered = string.sub(msg, 4, 12 + len)
    else                            -- MAVLink 1: no flags and one byte of message id
        covered = string.sub(msg, 4, 4) .. string.sub(msg, 7, 10) .. string.sub(msg, 13, 12 + len)
    end
    return x25(covered, MAV.CRC_EXTRA[msgid]) == crc
end

-- Counts a lease that is refused, and says why.
local function refuse(reason)
    refused.count = (refused.count + 1) & 0xFFFF
    refused.text = "lease refused, " .. reason
    if lease.live then
        say(MAV_SEVERITY.WARNING, "refuse", 60000, "strange " .. refused.text)
    else
        say(MAV_SEVERITY.WARNING, "refuse", 10000, refused.text)
    end
end

-- Refuses a lease of another version: guard and companion come from different releases.
local function refuse_version(version)
    refused.count = (refused.count + 1) & 0xFFFF
    refused.text = version < LEASE.VERSION and "companion is older, update it" or "guard is older, update it"
    say(MAV_SEVERITY.WARNING, "version", 10000, refused.text)
end

-- Replaces the nonce of this guard by the next number. A lease counts only if it carries this nonce, so a lease that
-- was recorded before this script started is refused. The companion learns the nonce from the status. The nonce changes
-- when another companion takes over: recordings of the former companion carry the former nonce. So no lease is accepted
-- twice.
function this_guard.next_nonce(now)
    this_guard.nonce = (this_guard.nonce + 1) & 0xFFFFFFFF
    if this_guard.nonce == 0 then
        this_guard.nonce = 1
    end
    this_guard.changed_at = now
end

-- Refuses a lease with another nonce than this guard's: it is for another guard, or older than a restart. 0 is a
-- companion that asks for the nonce. A companion uses the former nonce until it has heard of the new one: no message
-- then.
function this_guard.refuse_nonce(now, chan, nonce)
    this_guard.asked_at, this_guard.chan = now, chan
    if nonce == 0 or not this_guard.told then
        return
    end
    refused.count = (refused.count + 1) & 0xFFFF
    if elapsed(now, this_guard.changed_at or since.start) >= MS.SETTLE then
        refused.text = "lease for another guard or start"
        say(MAV_SEVERITY.WARNING, "guard nonce", lease.live and 60000 or 10000, refused.text)
    end
end

-- Decides whether a companion with another nonce may take over. A companion draws a nonce when it starts and keeps it.
-- Its sequence rises within a nonce, so a recorded lease cannot be replayed. A new nonce is a companion that has
-- restarted, or an attacker that pretends so. What counts is its epoch, compared with that of the last lease:
--   * newer: accepted at once. A companion that restarts continues with the epoch of its journal + 1, so it is never
--     delayed. A recording of an earlier run has an older epoch.
--   * equal: accepted after the last lease has expired. Such a companion died before its journal was written. While
--     leases with the former nonce come there are two companions, and the first one counts.
--   * older: refused while armed. On the ground it is accepted after the last lease has expired: the journal was wiped
--     or the computer exchanged, and no flight depends on it.
-- A nonce that was replaced never comes back (the last eight are remembered).
function lease.newcomer_objection(nonce, epoch)
    for i = 1, #lease.retired do
        if lease.retired[i] == nonce then
            return "old nonce"
        end
    end
    if serial_ahead(epoch, lease.epoch) then
        return nil
    end
    if not lease.live and (epoch == lease.epoch or not craft.armed) then
        return nil
    end
    return "nonce"
end

function lease.freshness_objection(nonce, sequence, epoch)
    if nonce == 0 then
        return "nonce"
    end
    if not lease.seen then
        return nil
    end
    if nonce ~= lease.nonce then
        return lease.newcomer_objection(nonce, epoch)
    end
    if not serial_ahead(sequence, lease.sequence) then
        return "sequence"
    end
    if epoch ~= lease.epoch and not serial_ahead(epoch, lease.epoch) then
        return "epoch"
    end
    return nil
end

function lease.channel_objection(chan)
    if config.chan >= 0 then
        if chan ~= config.chan then
            return string.format("channel %d not %d", chan, config.chan)
        end
    elseif lease.seen and chan ~= lease.chan and (lease.live or craft.armed) then
        return string.format("channel %d", chan)
    end
    return nil
end

function lease.accept(now, chan, stamp, lease_state, commander, flags, nonce, sequence, epoch, ttl_ms, left_s)
    if lease.seen and nonce ~= lease.nonce then
        lease.retired[#lease.retired + 1] = lease.nonce
        if #lease.retired > 8 then
            table.remove(lease.retired, 1)
        end
        this_guard.next_nonce(now)
    end
    lease.seen, lease.live, lease.two_guards = true, true, flags & LEASE.TWO_GUARDS ~= 0
    lease.state, lease.commander = lease_state, commander
    lease.nonce, lease.sequence, lease.epoch = nonce, sequence, epoch
    lease.ttl_ms = ttl_ms
    lease.at = stamp and stamp:toint() or now   -- when it was received: its age includes the time in the queue
    lease.chan = chan
    if lease_state == LEASE.ALONE then
        lease.commander = autopilot.sysid       -- for the GCS id: the GCS failsafe then watches the companion
        if not lease.alone_at then
            lease.alone_at, lease.alone_ms = lease.at, left_s * 1000
        end
    elseif lease_state <= LEASE.TRANSFER and commander ~= 0 then
        lease.alone_at = nil
    end
    refused.text, this_guard.asked_at = nil, nil
end

-- HalfSipHash-2-4 with a result of 64 bits (Aumasson and Bernstein): additions, rotations and xors of 32-bit words,
-- made for small processors. The tag of a lease costs about 950 VM instructions. Without the key it cannot be computed.
local function half_siphash(k0, k1, text)
    local mask = 0xFFFFFFFF
    local v0, v1, v2, v3 = k0, k1 ~ 0xEE, 0x6C796765 ~ k0, 0x74656462 ~ k1
    local function rounds(n)
        local a, b, c, d = v0, v1, v2, v3
        for _ = 1, n do
            a = (a + b) & mask
            b = ((b << 5 | b >> 27) & mask) ~ a
            a = (a << 16 | a >> 16) & mask
            c = (c + d) & mask
            d = ((d << 8 | d >> 24) & mask) ~ c
            a = (a + d) & mask
            d = ((d << 7 | d >> 25) & mask) ~ a
            c = (c + b) & mask
            b = ((b << 13 | b >> 19) & mask) ~ c
            c = (c << 16 | c >> 16) & mask
        end
        v0, v1, v2, v3 = a, b, c, d
    end
    local size = #text
    local whole = size - size % 4
    local tail = string.sub(text, whole + 1) .. string.rep("\0", 3 - size % 4) .. string.char(size & 0xFF)
    text = string.sub(text, 1, whole) .. tail       -- the last word: what is left over, and the length
    for i = 1, whole + 1, 4 do
        local word = string.unpack("<I4", text, i)
        v3 = v3 ~ word
        rounds(2)
        v0 = v0 ~ word
    end
    v2 = v2 ~ 0xEE
    rounds(4)
    local low = v1 ~ v3
    v1 = v1 ~ 0xDD
    rounds(4)
    return low, v1 ~ v3
end

-- The key of the tag: the first 8 of the 32 bytes in the file handover.key beside this script, written as 64
-- hexadecimal digits. Without the file, leases need no tag. With a file that cannot be used every lease is refused,
-- because its owner wants leases checked.
local key = {required=false, k0=nil, k1=nil}

function key.read()
    for _, path in ipairs({"/APM/scripts/handover.key", "scripts/handover.key"}) do
        local file = io and io.open(path, "r")
        if file then
            key.required = true
            local digits = string.match(file:read(80) or "", "^%s*(%x+)%s*$")
            file:close()
            if digits and #digits == 64 then
                local bytes = {}
                for i = 1, 8 do
                    bytes[i] = string.char(tonumber(string.sub(digits, 2 * i - 1, 2 * i), 16))
                end
                key.k0, key.k1 = string.unpack("<I4I4", table.concat(bytes))
            else
                say(MAV_SEVERITY.ERROR, "key", 0, "handover.key cannot be used")
            end
            return
        end
    end
end

-- Draws the nonce of this start: a hash of values that differ from one start to the next. It is drawn when the script
-- starts, and again with fresh sensor noise before the first status. Any of the sources may be missing or constant.
function this_guard.draw_nonce()
    local noise = {string.pack("<I4", this_guard.nonce)}
    local function add(format, get)
        pcall(function()
            noise[#noise + 1] = string.pack(format, get())
        end)
    end
    local function axes(vector)
        return vector:x(), vector:y(), vector:z()
    end
    add("<i4", function() return micros():toint() end)
    add("<f", function() return (param:get("STAT_BOOTCNT")) end)
    add("<fff", function() return axes(ahrs:get_gyro()) end)
    add("<fff", function() return axes(ahrs:get_accel()) end)
    add("<f", function() return baro:get_pressure() end)
    add("<f", function() return battery:voltage(0) end)
    add("<i4", function() return gps:time_week_ms(0):toint() end)
    this_guard.nonce = half_siphash(key.k0 or 0, key.k1 or 0, table.concat(noise))
    if this_guard.nonce == 0 then
        this_guard.nonce = 1
    end
end

-- The reason against the tag of a lease, nil if there is none. The tag covers payload type, target and lease, so the
-- tag of one vehicle's lease does not fit another vehicle.
function key.objection(body, flags)
    if not key.required then
        return nil
    end
    if flags & LEASE.TAGGED == 0 then
        return "no tag"
    end
    if not key.k0 then
        return "key file"
    end
    local low, high = half_siphash(key.k0, key.k1, string.sub(body, 1, 4) .. string.sub(body, 6, 29))
    if string.pack("<I4I4", low, high) ~= string.sub(body, 30, 37) then
        return "tag"
    end
    return nil
end

-- Checks a lease and accepts or refuses it. Returns how many sums (CRC, tag) were computed.
local function read_lease(now, msg, chan, stamp, crc, magic, len, sysid, compid)
    local objection = lease.channel_objection(chan)
    if not objection then
        if sysid ~= autopilot.sysid then
            objection = string.format("system %d", sysid)
        elseif compid ~= config.compid then
            objection = string.format("component %d", compid)
        elseif len > MAV.TUNNEL_HEAD_BYTES + LEASE.BYTES + LEASE.TAG_BYTES then
            objection = "length"
        end
    end
    if objection then
        refuse(objection)
        return 0
    end
    if not crc_fits(msg, magic, len, MAV.TUNNEL, crc) then
        refuse("CRC")
        return 1
    end
    -- MAVLink 2 does not send trailing zeros, and the bytes after the end of the message are undefined
    local full = MAV.TUNNEL_HEAD_BYTES + LEASE.BYTES + LEASE.TAG_BYTES
    local body = string.sub(msg, 13, 12 + len) .. string.rep("\0", full - len)
    local _, target, component, length, version, lease_state, commander, flags, nonce, sequence, epoch, ttl_ms, left_s,
        guard_nonce = string.unpack("<I2BBBBBBBI4I4I4I2I2I4", body)
    if target ~= autopilot.sysid or component ~= MAV.AUTOPILOT_COMPID then
        refuse("target")
        return 1
    end
    if version ~= LEASE.VERSION then
        refuse_version(version)
        return 1
    end
    local tagged = flags & LEASE.TAGGED
    if length ~= LEASE.BYTES + LEASE.TAG_BYTES * tagged or len > MAV.TUNNEL_HEAD_BYTES + length then
        objection = "length"
    elseif lease_state < LEASE.HELD or lease_state > LEASE.ALONE then
        objection = string.format("state %d", lease_state)
    else
        objection = key.objection(body, flags)
    end
    if not objection and guard_nonce ~= this_guard.nonce then
        this_guard.refuse_nonce(now, chan, guard_nonce)
        return key.required and 2 or 1
    end
    objection = objection or lease.freshness_objection(nonce, sequence, epoch)
    if objection then
        refuse(objection)
    else
        lease.accept(now, chan, stamp, lease_state, commander, flags, nonce, sequence, epoch, ttl_ms, left_s)
    end
    return key.required and 2 or 1
end

-- Executes DO_AUX_FUNCTION after the firmware leaves it to this script (from the first loss in flight on). It is denied
-- while authority is missing; otherwise it does what the firmware would do. To undo a mode is not enough: one moment in
-- STABILIZE with the throttle stick down stops ArduCopter's motors, and they stay stopped.
local function run_aux_function(msg)
    if enforcement ~= ENFORCEMENT.CALM then
        say(MAV_SEVERITY.WARNING, "aux", 10000, "DO_AUX of " .. rx.aux_by .. " denied")
        return MAV.RESULT_DENIED
    end
    local number, position = string.unpack("<ff", msg, 13)
    local ok, done = pcall(function()
        return rc:run_aux_function(math.floor(number), math.floor(position))
    end)
    return ok and done and MAV.RESULT_ACCEPTED or MAV.RESULT_FAILED
end

-- Handles two commands; returns how many sums were computed. MAV_CMD_SCRIPTING would stop this script: the firmware has
-- blocked it and does not answer it, so it is denied here. DO_AUX_FUNCTION is remembered, because it changes the mode
-- with the reason of a pilot's switch.
local function read_command(now, msg, chan, stamp, crc, magic, len, msgid, sysid, compid)
    local command = string.unpack("<I2", msg, 41)
    if command ~= MAV.CMD_SCRIPTING and command ~= MAV.CMD_AUX_FUNCTION then
        return 0
    end
    local is_aux = command == MAV.CMD_AUX_FUNCTION
    local will_run = is_aux and rx.aux_ours_at and enforcement == ENFORCEMENT.CALM
    local count = (rx.commands[command] or 0) + 1
    rx.commands[command] = count
    -- Each CRC costs time that leases need. So commands above the limit are ignored without a check.
    local flood = count > WORK.COMMANDS_A_SECOND and not will_run
    if not flood and not crc_fits(msg, magic, len, msgid, crc) then
        return 1
    end
    if is_aux then
        rx.aux_by = string.format("%d/%d", sysid, compid)
        local came_at = stamp and stamp:toint() or now
        if will_run or not rx.aux_ours_at or not serial_ahead(came_at, rx.aux_ours_at) then
            rx.aux_at = came_at     -- any other one is denied and changes no mode, so the pilot is still believed
        end
    end
    if flood then
        return 0
    end
    local result = MAV.RESULT_DENIED
    if is_aux then
        if not rx.aux_ours_at then
            return 1
        end
        result = run_aux_function(msg)
    else
        tampering.seen = true
        say(MAV_SEVERITY.WARNING, "command", 10000, string.format("scripting command of %d/%d denied", sysid, compid))
    end
    mavlink:send_chan(chan, MAV.COMMAND_ACK, string.pack("<I2BBi4BB", command, result, 0, 0, sysid, compid))
    return 1
end

-- Reads one frame; returns how many sums were computed.
local function read_frame(now, msg, chan, stamp)
    local crc, magic, len, _, _, _, sysid, compid, msgid = string.unpack("<I2BBBBBBBI3", msg)
    if msgid == MAV.TUNNEL then
        if len < MAV.TUNNEL_HEAD_BYTES or string.unpack("<I2", msg, 13) ~= LEASE.TYPE then
            return 0
        end
        return read_lease(now, msg, chan, stamp, crc, magic, len, sysid, compid)
    end
    if msgid == MAV.COMMAND_LONG or msgid == MAV.COMMAND_INT then
        return read_command(now, msg, chan, stamp, crc, magic, len, msgid, sysid, compid)
    end
    return 0
end

-- Reads frames until the queue is empty or the limits of WORK are reached. Returns true if frames may be left.
function rx.read(now)
    local most = rx.read_less and 1 or WORK.SUMS_PER_CALL
    for _ = 1, WORK.FRAMES_PER_CALL do
        local msg, chan, stamp = mavlink:receive_chan()
        if not msg then
            rx.in_a_row, rx.drained = 0, true
            return false
        end
        rx.heard[chan] = true
        rx.in_a_row = math.min(rx.in_a_row + 1, WORK.QUEUE_FRAMES)
        if rx.in_a_row == WORK.QUEUE_FRAMES then
            rx.full_at = now        -- the queue was full, and frames may have been lost
        end
        rx.sums = rx.sums + read_frame(now, msg, chan, stamp)
        if rx.sums >= most then
            return true
        end
    end
    return true
end

-- ----------------------------------------------------------------------- registrations, GCS id, status and log

-- Creates the receive table. It is common to all scripts, and on 4.6 a second init() with more ids writes past its end.
-- So init() is called only if no script has called it yet: receive_chan() raises an error then.
function rx.init()
    if not pcall(mavlink.receive_chan, mavlink) then
        rx.own_table = true
        mavlink:init(WORK.QUEUE_FRAMES, #rx.ids)
    else
        say(MAV_SEVERITY.NOTICE, "shared", 0, "MAVLink rx was in use before")
    end
end

-- Registers the message ids again, because another script may have wiped them. If no entry is free, the table is
-- emptied. If another script has created it, only one entry is safe, and the lease gets it. This works on 4.6; on 4.5
-- and 4.7 a second init() changes nothing.
function rx.register(now, at_start)
    for i = 1, #rx.ids do
        local ok, was_missing = pcall(mavlink.register_rx_msgid, mavlink, rx.ids[i])
        if not ok then
            notice_tampering(now, "MAVLink rx taken by another script")
            if not rx.own_table then
                rx.ids, rx.no_commands = {MAV.TUNNEL}, true
            end
            mavlink:init(WORK.QUEUE_FRAMES, #rx.ids)
            for k = 1, #rx.ids do
                pcall(mavlink.register_rx_msgid, mavlink, rx.ids[k])
            end
            break
        elseif was_missing and not at_start then
            notice_tampering(now, "MAVLink rx was reset by a script")
        elseif at_start and not was_missing and rx.ids[i] == MAV.TUNNEL then
            -- The lease's id is registered already: by a second guard, or by this one before scripting was restarted.
            -- Time tells the two apart: after a boot, scripts start within a minute. After such a restart this script
            -- may be the first to ask for an authorisation (4.7). Up to 4.6 the authorisation of the former run is
            -- still there.
            local early = since.start >= 0 and since.start < MS.BOOT
            local not_first = auth_id ~= nil and auth_id > 0
            rx.second_guard, rx.restarted = not_first and early, not_first and not early
        end
    end
    if mavlink.block_command then
        mavlink:block_command(MAV.CMD_SCRIPTING)
    end
end

local gcs_id = {name="MAV_GCS_SYSID", set=nil, epoch=nil, nonce=nil}
do
    local present = param:get(gcs_id.name)
    if present == nil then
        gcs_id.name = "SYSID_MYGCS" -- up to 4.6
    end
end

-- Sets the autopilot's GCS id to the commander. The firmware counts FS_GCS_TIMEOUT from the last heartbeat of the
-- former commander, so the new one must be heard within that time. Newer firmware accepts a range of ids: its upper end
-- is set to 0, so that only the commander counts.
function gcs_id.follow()
    if not (config.sysid_sw and autopilot.known) or state ~= STATE.LIVE then
        return
    end
    local present = param:get(gcs_id.name)
    local high = param:get("MAV_GCS_SYSID_HI")
    local known = gcs_id.set == lease.commander and gcs_id.epoch == lease.epoch and gcs_id.nonce == lease.nonce
    if present == lease.commander and not (high and high > 0) then
        gcs_id.set, gcs_id.epoch, gcs_id.nonce = lease.commander, lease.epoch, lease.nonce
        return
    end
    if known and present then
        tampering.seen = true
        say(MAV_SEVERITY.WARNING, "gcs id", 10000, gcs_id.name .. " was changed, set again")
    end
    if high and high > 0 then
        param:set("MAV_GCS_SYSID_HI", 0)
    end
    gcs_id.set, gcs_id.epoch, gcs_id.nonce = lease.commander, lease.epoch, lease.nonce
    if not param:set(gcs_id.name, lease.commander) then
        say(MAV_SEVERITY.ERROR, "gcs id", 10000, gcs_id.name .. " cannot be set")
    end
end

-- The last status that was sent. A change of one of these fields sends a status, and writes a log record, at once.
local status = {state=-1, action=-1, flags=-1, epoch=0, nonce=0, guard_nonce=0, enforcement=-1, commander=0}

function status.flags_now()
    local flags = 0
    local stands_back = enforcement == ENFORCEMENT.PILOT or enforcement == ENFORCEMENT.FAILSAFE
    if enforcement ~= ENFORCEMENT.CALM and craft.armed and not stands_back then flags = flags | STATUS.ENFORCING end
    if craft.armed then flags = flags | STATUS.ARMED end
    if craft.flying then flags = flags | STATUS.FLYING end
    if tampering.seen then flags = flags | STATUS.TAMPERED end
    if not autopilot.known then flags = flags | STATUS.UNKNOWN_VEHICLE end
    if rx.second_guard then flags = flags | STATUS.SECOND end
    return flags
end

-- Sends the status. Returns false if the link has no room now and the status must be sent again. Firmware before the
-- end of 2025 crashes on a message to a channel without a port. So the guard sends only where it has heard a frame.
function status.send(flags)
    local chan = config.chan
    if chan < 0 then
        chan = lease.chan >= 0 and lease.chan or this_guard.chan   -- -1 until a companion was heard
    end
    if not rx.heard[chan] then
        return true
    end
    if not this_guard.told then
        this_guard.draw_nonce()
        this_guard.told = true
    end
    local length = STATUS.BYTES
    if key.k0 then
        flags, length = flags | STATUS.TAGGED, length + LEASE.TAG_BYTES
    end
    local address = string.pack("<I2BB", STATUS.TYPE, autopilot.sysid, config.compid)
    local body = string.pack("<BBBBI4I4I4I2BBI4", STATUS.VERSION, state, loss.action, flags, lease.nonce,
                             lease.sequence, lease.epoch, refused.count, autopilot.major, autopilot.minor,
                             this_guard.nonce)
    local text = address .. string.char(length) .. body
    if key.k0 then
        text = text .. string.pack("<I4I4", half_siphash(key.k0, key.k1, address .. body))
    end
    text = text .. string.rep("\0", MAV.TUNNEL_BYTES - #text)
    local ok, room = pcall(mavlink.send_chan, mavlink, chan, MAV.TUNNEL, text)
    if not ok then
        say(MAV_SEVERITY.ERROR, "answer", math.maxinteger, string.format("no answer on channel %d", chan))
    end
    return not ok or room
end

-- Sends the status if it is due. Returns true if it was sent because a field has changed.
function status.report(now)
    local flags = status.flags_now()
    local changed = status.state ~= state or status.action ~= loss.action or status.flags ~= flags or
        status.epoch ~= lease.epoch or status.nonce ~= lease.nonce or status.enforcement ~= enforcement or
        status.guard_nonce ~= this_guard.nonce
    local asked = this_guard.asked_at and elapsed(now, this_guard.asked_at) < MS.ASKED
    if this_guard.told and not changed and elapsed(now, since.status) < (asked and MS.HELLO or MS.STATUS) then
        return false
    end
    rx.read_less = key.k0 ~= nil and rx.sums >= WORK.SUMS_PER_CALL
    if rx.read_less then
        return false
    end
    if not status.send(flags) then
        return false                -- no room on the link: try in the next call
    end
    status.state, status.enforcement, status.action, status.flags = state, enforcement, loss.action, flags
    status.epoch, status.nonce, status.guard_nonce = lease.epoch, lease.nonce, this_guard.nonce
    since.status = now
    return changed
end

function status.log(now)
    if not logger or not logger.write then
        return
    end
    local age_ms = lease.seen and elapsed(now, lease.at) or 0
    logger:write("HNDO", "St,Ac,Fl,Cmd,LSt,Ep,Seq,Age,Rej,En", "BBBBBIIIHB", "-------s--", "-------C--", state,
                 loss.action, status.flags_now(), lease.commander, lease.state, lease.epoch, lease.sequence, age_ms,
                 refused.count, enforcement)
end

local function every_second(now)
    autopilot.sysid = math.floor(param:get("MAV_SYSID") or param:get("SYSID_THISMAV") or 1)
    rx.commands = {}
    if rx.aux_at and elapsed(now, rx.aux_at) >= MS.TAMPER_HOLD then
        rx.aux_at = nil             -- before the 32-bit clock makes an old time look new
    end
    if rx.full_at and elapsed(now, rx.full_at) >= MS.TAMPER_HOLD then
        rx.full_at = nil
    end
    if not autopilot.known then
        say(MAV_SEVERITY.ERROR, "type", MS.TYPE, autopilot.name .. " not supported")
    end
    if (rx.second_guard or rx.restarted) and not craft.armed then
        say(MAV_SEVERITY.ERROR, "second", 30000, rx.second_guard and TEXT.TWO_GUARDS or TEXT.RESTARTED)
    end
    rx.register(now, false)
    gcs_id.follow()
end

local function announce_commander()
    local commander = state == STATE.LIVE and lease.commander or 0
    if commander ~= status.commander and commander ~= 0 then
        local who = lease.state == LEASE.ALONE and "nobody" or commander
        say(MAV_SEVERITY.INFO, "commander", 500, "lease live, " .. who .. " commands")
    end
    status.commander = commander
end

-- Everything that is not enforcement: arming, messages, GCS id, status, log.
local function housekeeping(now)
    update_state(now)
    permit_arming(now)
    announce_commander()
    if gcs_id.epoch ~= lease.epoch or gcs_id.nonce ~= lease.nonce or gcs_id.set ~= lease.commander then
        gcs_id.follow()
    end
    local changed = status.report(now)
    local due = elapsed(now, since.second) >= MS.SECOND
    if due then
        since.second = now
    end
    if changed or due then
        status.log(now)
    end
    if due then
        every_second(now)
    end
end

-- ------------------------------------------------------------------------------------------------ running

-- Calls f(now). An error is logged and reported, and does not end this script. Returns true and the result, or false.
local function protected(f, now)
    local ok, result = pcall(f, now)
    if ok then
        return true, result
    end
    running.fault_at = now
    pcall(say, MAV_SEVERITY.ERROR, "fault", 10000, "fault " .. tostring(result))
    return false, nil
end

-- The main loop. It enforces before it parses, so that a flood of frames cannot delay enforcement.
local function update()
    local now = clock()
    local stalled = elapsed(now, since.last_run) > MS.STALL
    local always_late = stalled and running.late    -- not a single stall: the scheduler is always late
    since.last_run, running.late, rx.sums = now, stalled, 0
    protected(config.read, now)
    if stalled then
        running.catch_up = WORK.CATCH_UP_CALLS
    end
    local _, more
    local catching_up = running.catch_up > 0
    if catching_up then             -- after a stall, newer leases may wait in the queue: read them before enforcement
        _, more = protected(rx.read, now)
        running.catch_up = more and running.catch_up - 1 or 0
    end
    if running.catch_up == 0 or always_late then
        if not protected(enforce, now) then
            protected(last_resort, now)
        end
        if not catching_up then     -- read the queue only once in a call, for the limit of instructions
            _, more = protected(rx.read, now)
        end
    end
    if not protected(housekeeping, now) and auth_id and state ~= STATE.DISABLED then
        -- the authorisation may date from before the fault
        pcall(arming.set_aux_auth_failed, arming, auth_id, TEXT.PREFIX .. TEXT.FAULT)
    end
    if more or craft.reads_left > 0 or rx.read_less then
        return update, MS.BUSY
    end
    return update, MS.UPDATE
end

key.read()
this_guard.draw_nonce()
rx.init()
rx.register(since.start, true)
autopilot.sysid = math.floor(param:get("MAV_SYSID") or param:get("SYSID_THISMAV") or 1)
say(MAV_SEVERITY.INFO, "loaded", 0, "handover guard " .. TEXT.VERSION .. (key.required and " loaded, key" or " loaded"))

return update, MS.UPDATE
