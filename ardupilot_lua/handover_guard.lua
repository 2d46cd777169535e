-- SPDX-License-Identifier: GPL-3.0-or-later
--
-- Handover guard: no authority, no flight.
--
-- A companion computer decides which ground control station commands this vehicle and tells the autopilot so five
-- times a second, in a "lease". This script watches the lease. Without a live one the vehicle does not arm; in flight
-- it returns home, even when every computer above the flight controller has died. See handover_guard.md.
--
-- Parameters
--   HNDO_ENABLE     0: off, 1: on
--   HNDO_TIMEOUT    seconds without a lease until it counts as lost
--   HNDO_LOST_T     seconds that a lease may say "nobody commands" in flight
--   HNDO_ACTION     1: RTL, 2: SMART_RTL, 3: LAND
--   HNDO_CHAN       MAVLink channel of the companion, -1: any
--   HNDO_COMPID     component id of the companion
--   HNDO_SYSID_SW   1: the autopilot's GCS id follows the commander
--
-- How to use
--   1. copy this file to the scripts directory of the autopilot's SD card (APM/scripts)
--   2. load handover.parm, set HNDO_CHAN to the port of the companion, reboot
--   3. start the companion; "HNDO: lease live" appears and the vehicle can be armed
--   Where other than the companion may write to its port: put a key beside this file, see handover_guard.md.
--
-- How to test in SITL
--   1. copy this file to "scripts" in the working directory of the simulation, load handover.parm
--   2. arm: refused ("HNDO: no lease from companion"); start the companion on SERIAL1 (tcp 5762); arm: accepted
--   3. fly in GUIDED, stop the companion: RTL after HNDO_TIMEOUT
--
-- CAUTION: needs firmware 4.5 or later. Run it alone: all scripts share one MAVLink receive queue, a second script
-- that receives MAVLink takes leases away from this one.
--
-- Numbers: Lua integers have 32 bits on the autopilot and 64 on a desktop. Everything that comes from the wire or the
-- clock is masked to 32 bits and compared by serial_ahead() or elapsed(), which are right in both.

-- Constants and state stand in tables: ArduPilot's Lua allows 100 local variables in a function, this file being one.

local MAV_SEVERITY = {EMERGENCY=0, ALERT=1, CRITICAL=2, ERROR=3, WARNING=4, NOTICE=5, INFO=6, DEBUG=7}

local TEXT = {
    VERSION = "0.1",
    PREFIX = "HNDO: ",
    BYTES = 50,                     -- one STATUSTEXT
    AUTH_BYTES = 41,                -- longest reason that the arming check shows
}

local MS = {
    UPDATE = 50,                    -- a lease that dies is noticed within this time
    BUSY = 10,                      -- next call while the receive queue is not empty yet
    STALL = 500,                    -- woken later than this: the script slept, not the companion
    STATUS = 500,                   -- status to the companion
    SECOND = 1000,                  -- registrations, ids and log
    LANDED = 3000,                  -- after a flight, this long on the ground before the motors are stopped
    TAMPER_HOLD = 10000,            -- no arming for this long after the registrations were wiped
}

-- Work per call. A script that uses more than 10000 VM instructions in a call is removed for good, pcall or not; a
-- frame costs about 60 of them, one whose CRC is computed up to 1000, and the tag of a lease as much again.
local WORK = {
    QUEUE_FRAMES = 25,
    FRAMES_PER_CALL = 12,
    SUMS_PER_CALL = 3,              -- CRCs and tags; the frame that reaches it is read to its end
    CATCH_UP_CALLS = 13,            -- after a stall: empties a full queue of leases before anything is judged (0.15 s)
}

local MODE = {LAND=9, RTL=6, SMART_RTL=21}
local RETURN_MODES = {[6]="RTL", [21]="SMART_RTL", [27]="AUTO_RTL"}
-- modes in which a pilot steers by hand: STABILIZE ACRO ALT_HOLD LOITER DRIFT SPORT FLIP POSHOLD FLOWHOLD
local MANUAL_MODES = {[0]=true, [1]=true, [2]=true, [5]=true, [11]=true, [13]=true, [14]=true, [16]=true, [22]=true}

-- ModeReason of the firmware: who chose the present flight mode
local PILOT_REASONS = {[1]=true, [18]=true, [42]=true, [53]=true}       -- RC, toy, RC telemetry, RC auxiliary switch
local FAILSAFE_REASONS = {[3]=true, [4]=true, [5]=true, [6]=true, [7]=true, [10]=true, [11]=true, [14]=true,
                          [17]=true, [19]=true, [25]=true, [50]=true}   -- radio, battery, GCS, EKF, fence, terrain, ...
local COMMAND_REASONS = {[2]=true, [32]=true, [52]=true}                -- GCS, a script, DDS

-- what is tried in flight, in this order: mode, its number in the status, and the wait after a refusal. A refused mode
-- costs a STATUSTEXT, an error in the log and a buzzer, hence the pauses.
local ACTION = {NONE=0, RTL=1, SMART_RTL=2, LAND=3, DISARM=4}
local LADDERS = {}
do
    local rtl_1 = {mode=MODE.RTL, action=ACTION.RTL, name="RTL", wait_ms=1000}
    local rtl_2 = {mode=MODE.RTL, action=ACTION.RTL, name="RTL", wait_ms=2000}
    local rtl_3 = {mode=MODE.RTL, action=ACTION.RTL, name="RTL", wait_ms=0}
    local smart = {mode=MODE.SMART_RTL, action=ACTION.SMART_RTL, name="SMART_RTL", wait_ms=0}
    local land = {mode=MODE.LAND, action=ACTION.LAND, name="LAND", wait_ms=2000}
    LADDERS[ACTION.RTL] = {rtl_1, rtl_2, rtl_3, land}
    LADDERS[ACTION.SMART_RTL] = {smart, rtl_1, rtl_2, rtl_3, land}
    LADDERS[ACTION.LAND] = {land}
end

local MAV = {
    TUNNEL = 385,
    COMMAND_LONG = 76,
    COMMAND_INT = 75,
    COMMAND_ACK = 77,
    CRC_EXTRA = {[385]=147, [76]=152, [75]=158},
    CMD_SCRIPTING = 42701,
    RESULT_DENIED = 2,
    AUTOPILOT_COMPID = 1,
    MAGIC_2 = 0xFD,
    TUNNEL_BYTES = 133,
    TUNNEL_HEAD_BYTES = 5,          -- payload_type, target_system, target_component, payload_length
}

-- the lease and the answer to it
local LEASE = {TYPE=47116, BYTES=20, VERSION=1, HELD=1, TRANSFER=2, LOST=3, RECOVERING=4, TAG_BYTES=8, TAGGED=1}
local STATUS = {TYPE=47117, BYTES=20, VERSION=1}
local STATE = {DISABLED=0, WAITING=1, LIVE=2, EXPIRED=3, LOST=4}

-- ------------------------------------------------------------------------------------------------ parameters

local PARAM_TABLE_KEY = 147
local PARAM_TABLE_PREFIX = "HNDO_"
local HNDO = {}
assert(param:add_table(PARAM_TABLE_KEY, PARAM_TABLE_PREFIX, 7), "HNDO: could not add param table")

local function bind_add_param(name, idx, default_value)
    assert(param:add_param(PARAM_TABLE_KEY, idx, name, default_value), "HNDO: could not add param " .. name)
    return Parameter(PARAM_TABLE_PREFIX .. name)
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
  // @Description: Time without a lease after which it counts as lost. A lease that names a shorter life of its own dies sooner. Keep FS_GCS_TIMEOUT longer.
  // @Range: 1 30
  // @Units: s
  // @User: Standard
--]]
HNDO.TIMEOUT = bind_add_param("TIMEOUT", 2, 3)

--[[
  // @Param: HNDO_LOST_T
  // @DisplayName: Handover lost time
  // @Description: Time that live leases may say that no station has authority before the vehicle is sent home. The companion, which sends them, is expected to act first. Keep it longer than the companion tries a forced transfer (forced_timeout_s, 2 s).
  // @Range: 0 60
  // @Units: s
  // @User: Standard
--]]
HNDO.LOST_T = bind_add_param("LOST_T", 3, 3)

--[[
  // @Param: HNDO_ACTION
  // @DisplayName: Handover guard action
  // @Description: What is done in flight when authority is lost. If the mode is refused: SMART_RTL falls back to RTL, RTL to LAND.
  // @Values: 1:RTL,2:SmartRTL,3:Land
  // @User: Standard
--]]
HNDO.ACTION = bind_add_param("ACTION", 4, 1)

--[[
  // @Param: HNDO_CHAN
  // @DisplayName: Handover companion channel
  // @Description: MAVLink channel the companion is wired to, counted over the ports that speak MAVLink: on a Cube Orange 0 is USB, 1 TELEM1, 2 TELEM2. Leases from other channels are refused. -1 takes the first channel that brings a good lease.
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

-- ------------------------------------------------------------------------------------------------ state

local config = {enable=true, timeout_ms=3000, lost_ms=1000, action=ACTION.RTL, chan=1, compid=191, sysid_sw=true}
local lease = {seen=false, live=false, nonce=0, sequence=0, epoch=0, state=0, commander=0, ttl_ms=0, at=0, chan=-1}
local retired = {}                  -- nonces of earlier companion runs, newest last
local refused = {count=0, reason=nil}
local state = STATE.WAITING
local loss = {active=false, action=ACTION.NONE, resorted=false}
local craft = {armed=false, flying=false, flown=false, flown_at=0, disarm_tried=false, disarm_at=0}
local tampering = {seen=false, at=nil}
local own_sysid = 1
local said_at = {}

local function clock()
    return millis():toint()
end

-- milliseconds since an instant; 0 when it lies ahead, as the stamp of a frame that came in during this very call may
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

local since = {}                    -- instants
since.start = clock()
since.last_run, since.status, since.second, since.lost = since.start, since.start, since.start, since.start
local grace_over = false            -- a guard that has just started gives the companion HNDO_TIMEOUT to appear
local catch_up = 0

-- at most one text of a kind in gap_ms
local function say(severity, kind, gap_ms, text)
    local now = clock()
    local before = said_at[kind]
    if before and elapsed(now, before) < gap_ms then
        return
    end
    said_at[kind] = now
    gcs:send_text(severity, string.sub(TEXT.PREFIX .. text, 1, TEXT.BYTES))
end

local function notice_tampering(now, text)
    tampering.seen = true
    tampering.at = now
    say(MAV_SEVERITY.WARNING, "tamper", 10000, text)
end

local function value_of(parameter, low, high)
    local v = parameter:get()
    if not v or v ~= v or v < low then
        return low
    end
    if v > high then
        return high
    end
    return v
end

local function read_config(now)
    local enable = value_of(HNDO.ENABLE, 0, 1) >= 0.5
    if enable ~= config.enable then
        config.enable = enable
        since.start, grace_over = now, false
        if not enable then
            say(MAV_SEVERITY.WARNING, "disabled", 2000, "guard disabled")
        end
    end
    config.timeout_ms = math.floor(value_of(HNDO.TIMEOUT, 0.5, 60) * 1000)
    config.lost_ms = math.floor(value_of(HNDO.LOST_T, 0, 60) * 1000)
    config.action = math.floor(value_of(HNDO.ACTION, ACTION.RTL, ACTION.LAND))
    config.chan = math.floor(value_of(HNDO.CHAN, -1, 15))
    config.compid = math.floor(value_of(HNDO.COMPID, 1, 255))
    config.sysid_sw = value_of(HNDO.SYSID_SW, 0, 1) >= 0.5
end

-- ------------------------------------------------------------------------------------------------ who commands

-- HELD and TRANSFER name a commander. A lease without one says that nobody has authority, whatever state it claims.
local function nobody_commands()
    return lease.state == LEASE.LOST or lease.commander == 0
end

local function judge(now)
    if lease.live and elapsed(now, lease.at) >= math.min(config.timeout_ms, lease.ttl_ms) then
        lease.live = false          -- latched: only a newly accepted lease revives it
    end
    if not grace_over and elapsed(now, since.start) >= config.timeout_ms then
        grace_over = true
    end
    local before = state
    if not config.enable then
        state = STATE.DISABLED
    elseif not lease.seen then
        state = STATE.WAITING
    elseif not lease.live then
        state = STATE.EXPIRED
    elseif nobody_commands() then
        state = STATE.LOST
    else
        state = STATE.LIVE
    end
    if state == STATE.LOST and before ~= STATE.LOST then
        since.lost = now
    end
end

-- whether authority is missing, for longer than it may
local function authority_missing(now)
    if state == STATE.WAITING or state == STATE.EXPIRED then
        return grace_over
    end
    if state == STATE.LOST then     -- a loss that began with silence does not end with a lease that says LOST
        return loss.active or elapsed(now, since.lost) >= config.lost_ms
    end
    return false
end

local function arming_objection(now)
    if state == STATE.DISABLED then
        return nil
    end
    if craft.armed then             -- see permit_arming
        return "guard stopped while armed"
    end
    if tampering.at and elapsed(now, tampering.at) < MS.TAMPER_HOLD then
        return "another script tampers"
    end
    tampering.at = nil
    if state == STATE.LIVE then
        if lease.state == LEASE.HELD or lease.state == LEASE.TRANSFER then
            return nil
        end
        return "authority is being recovered"
    end
    if state == STATE.LOST then
        return "no station has authority"
    end
    if refused.reason then
        return "lease refused, " .. refused.reason
    end
    if state == STATE.EXPIRED then
        return "lease lost"
    end
    return "no lease from companion"
end

local auth_id = arming:get_aux_auth_id()
if not auth_id then                 -- the firmware then refuses to arm by itself: too many authorisers
    say(MAV_SEVERITY.ERROR, "auth", 0, "no arming authorisation to be had")
end

-- Authorisation is lent, not given: the firmware keeps the last answer of a script that has died. It is taken back as
-- soon as the motors run (nobody asks for it then): a script killed in flight leaves a vehicle that does not arm.
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

-- ------------------------------------------------------------------------------------------------ enforcement

local function mode_reason()
    if vehicle.get_control_mode_reason then
        return vehicle:get_control_mode_reason()
    end
    return nil
end

local function loss_name()
    if state == STATE.LOST then
        return "no authority"
    end
    return lease.seen and "lease lost" or "no lease"
end

local function forget_flight()
    loss.looked = false             -- has this loss been looked at in this flight
    loss.engaged = false            -- has a mode of the guard been accepted, or nothing been needed
    loss.mode = nil                 -- mode that this loss has settled in
    loss.first_mode = nil
    loss.attempts = 0
    loss.wait_ms = 0
    loss.tried_at = 0
    loss.stands_back = false
end
forget_flight()

local function begin_loss()
    loss.active = true
    forget_flight()
    if not craft.armed then
        say(MAV_SEVERITY.NOTICE, "loss", 2000, loss_name())
    end
end

local function end_loss()
    loss.active = false
    loss.action = ACTION.NONE
    if state ~= STATE.LIVE or not craft.flying then
        return
    end
    if loss.mode == MODE.LAND then
        say(MAV_SEVERITY.NOTICE, "back", 1000, "authority back, staying in LAND")
    elseif RETURN_MODES[loss.mode] then
        say(MAV_SEVERITY.NOTICE, "back", 1000, "authority back, staying in " .. RETURN_MODES[loss.mode])
    else
        say(MAV_SEVERITY.NOTICE, "back", 1000, "authority back")
    end
end

local function settle(mode, stands_back, text)
    say(MAV_SEVERITY.NOTICE, "settle", 2000, loss_name() .. ", " .. text)
    loss.engaged, loss.mode = true, mode
    loss.stands_back = stands_back
    loss.attempts = 0
end

local function send_home(now, undoing)
    loss.stands_back = false
    if loss.attempts > 0 and elapsed(now, loss.tried_at) < loss.wait_ms then
        return
    end
    local ladder = LADDERS[config.action] or LADDERS[ACTION.RTL]
    local try = ladder[math.min(loss.attempts + 1, #ladder)]
    loss.attempts = math.min(loss.attempts + 1, #ladder)
    loss.tried_at, loss.wait_ms = now, try.wait_ms
    if not vehicle:set_mode(try.mode) then
        say(MAV_SEVERITY.CRITICAL, "refused", 1000, loss_name() .. ", " .. try.name .. " refused")
        return
    end
    loss.engaged, loss.mode, loss.action = true, try.mode, try.action
    loss.attempts = 0
    if undoing then
        say(MAV_SEVERITY.WARNING, "undone", 2000, "no authority, mode change undone")
    else
        say(MAV_SEVERITY.CRITICAL, "action", 1000, loss_name() .. ", " .. try.name)
    end
end

-- A pilot who takes over by RC after the guard has acted is not fought. One who already steers by hand when authority
-- is lost keeps the aircraft: the loss concerns the stations, and the radio failsafe watches over the pilot's own link.
local function pilot_has_it(mode, reason)
    if not PILOT_REASONS[reason] then
        return false
    end
    if loss.engaged or mode ~= loss.first_mode then
        return true
    end
    return MANUAL_MODES[mode] and rc ~= nil and rc:has_valid_input()
end

local function enforce_in_flight(now)
    local mode, reason = vehicle:get_mode(), mode_reason()
    local first = not loss.looked
    if first then
        loss.looked, loss.first_mode = true, mode
    end
    if mode == loss.mode then       -- what was set or found; the mode decides, its reason may be overwritten
        return
    end
    if RETURN_MODES[mode] then
        settle(mode, false, "in " .. RETURN_MODES[mode])
        return
    end
    -- LAND may have been chosen before the loss, by a failsafe, by the pilot, or by the companion that says LOST
    if mode == MODE.LAND and (first or not COMMAND_REASONS[reason] or state == STATE.LOST) then
        settle(mode, false, "in LAND")
        return
    end
    if FAILSAFE_REASONS[reason] then
        settle(mode, true, "failsafe acts")
        return
    end
    if pilot_has_it(mode, reason) then
        settle(mode, true, "pilot flies")
        return
    end
    if reason == nil and loss.engaged then  -- firmware that cannot tell who: it may be the pilot
        settle(mode, true, "mode left alone")
        return
    end
    send_home(now, loss.engaged)
end

-- A script's disarm stops the motors in the air as well: be sure of the ground.
local function enforce_on_ground(now)
    if craft.flown and elapsed(now, craft.flown_at) < MS.LANDED then
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

local function observe(now)
    craft.armed = arming:is_armed()
    craft.flying = craft.armed and vehicle:get_likely_flying()
    if not craft.armed then
        craft.flown, craft.disarm_tried = false, false
    elseif craft.flying then
        craft.flown, craft.flown_at = true, now
    end
end

local function enforce(now)
    judge(now)
    observe(now)
    local missing = authority_missing(now)
    if missing and not loss.active then
        begin_loss()
    elseif loss.active and not missing then
        end_loss()
    end
    if not loss.active then
        return
    end
    if not craft.armed then
        forget_flight()
    elseif craft.flying then
        enforce_in_flight(now)
    else
        enforce_on_ground(now)
    end
end

-- When enforcement itself fails, for a binding that this firmware does not have: one plain RTL for each loss.
local function last_resort(now)
    judge(now)
    if not authority_missing(now) then
        loss.resorted = false
    elseif not loss.resorted and arming:is_armed() then
        loss.resorted = true
        if not RETURN_MODES[vehicle:get_mode()] then
            vehicle:set_mode(MODE.RTL)
        end
    end
end

-- ------------------------------------------------------------------------------------------------ the lease

-- X.25 checksum as MAVLink uses it. Corrupted messages reach scripts too, so it is computed for every lease.
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

local function refuse(reason)
    refused.count = (refused.count + 1) & 0xFFFF
    refused.reason = reason
    if lease.live then
        say(MAV_SEVERITY.WARNING, "refuse", 60000, "strange lease refused, " .. reason)
    else
        say(MAV_SEVERITY.WARNING, "refuse", 10000, "lease refused, " .. reason)
    end
end

-- Which companion may speak. It draws a nonce when it starts and keeps it; the sequence rises within a nonce, so a
-- recorded lease cannot be played again. A new nonce is a companion that has restarted, or somebody who pretends so:
--   * its epoch is newer than the last one: accepted at once. A companion takes epoch + 1 from its journal when it
--     restarts, so a lawful restart is never delayed, and a recording of an earlier run has an older epoch.
--   * its epoch is the same: accepted once the old nonce has fallen silent and its lease is dead. That is a companion
--     that died before its journal was written; as long as the old one speaks there are two, and the first one counts.
--   * its epoch is older: stale, refused while armed. On the ground, with the old lease dead, it is accepted: the
--     journal was wiped or the computer exchanged, and nothing flies on it.
-- A nonce that was replaced never comes back (the last eight are remembered).
local function newcomer_objection(nonce, epoch)
    for i = 1, #retired do
        if retired[i] == nonce then
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

local function freshness_objection(nonce, sequence, epoch)
    if nonce == 0 then
        return "nonce"
    end
    if not lease.seen then
        return nil
    end
    if nonce ~= lease.nonce then
        return newcomer_objection(nonce, epoch)
    end
    if not serial_ahead(sequence, lease.sequence) then
        return "sequence"
    end
    if epoch ~= lease.epoch and not serial_ahead(epoch, lease.epoch) then
        return "epoch"
    end
    return nil
end

local function channel_objection(chan)
    if config.chan >= 0 then
        if chan ~= config.chan then
            return string.format("channel %d not %d", chan, config.chan)
        end
    elseif lease.seen and chan ~= lease.chan and (lease.live or craft.armed) then
        return string.format("channel %d", chan)
    end
    return nil
end

local function accept(now, chan, stamp, lease_state, commander, nonce, sequence, epoch, ttl_ms)
    if lease.seen and nonce ~= lease.nonce then
        retired[#retired + 1] = lease.nonce
        if #retired > 8 then
            table.remove(retired, 1)
        end
    end
    lease.seen, lease.live = true, true
    lease.state, lease.commander = lease_state, commander
    lease.nonce, lease.sequence, lease.epoch = nonce, sequence, epoch
    lease.ttl_ms = ttl_ms
    lease.at = stamp and stamp:toint() or now   -- when it came in: waiting in the queue does not keep it young
    lease.chan = chan
    refused.reason = nil
end

-- HalfSipHash-2-4 with 64 bits of result (Aumasson and Bernstein): adds, turns and xors of 32-bit words, made for small
-- processors. A lease costs it about 950 VM instructions. Unlike a CRC it cannot be computed without the key.
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

-- The key of the tag: the first 8 of the 32 bytes in a file beside this one, written as 64 hexadecimal digits. No file:
-- no tag is asked for. A file that cannot be used: no lease is good, because somebody wanted them checked.
local key = {required=false, k0=nil, k1=nil}

local function read_key()
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

-- The tag covers payload type, target and the lease: what is right for one vehicle is wrong for any other.
local function tag_objection(body, flags)
    if not key.required then
        return nil
    end
    if flags & LEASE.TAGGED == 0 then
        return "no tag"
    end
    if not key.k0 then
        return "key file"
    end
    local low, high = half_siphash(key.k0, key.k1, string.sub(body, 1, 4) .. string.sub(body, 6, 25))
    if string.pack("<I4I4", low, high) ~= string.sub(body, 26, 33) then
        return "tag"
    end
    return nil
end

-- returns how many sums were computed
local function read_lease(now, msg, chan, stamp, crc, magic, len, sysid, compid)
    local objection = channel_objection(chan)
    if not objection then
        if sysid ~= own_sysid then
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
    -- trailing zeros are not sent, and what stands behind the end of the message is not to be trusted
    local full = MAV.TUNNEL_HEAD_BYTES + LEASE.BYTES + LEASE.TAG_BYTES
    local body = string.sub(msg, 13, 12 + len) .. string.rep("\0", full - len)
    local _, target, component, length, version, lease_state, commander, flags, nonce, sequence, epoch, ttl_ms =
        string.unpack("<I2BBBBBBBI4I4I4I2", body)
    local tagged = flags & LEASE.TAGGED
    if target ~= own_sysid or component ~= MAV.AUTOPILOT_COMPID then
        objection = "target"
    elseif length ~= LEASE.BYTES + LEASE.TAG_BYTES * tagged or len > MAV.TUNNEL_HEAD_BYTES + length then
        objection = "length"
    elseif version ~= LEASE.VERSION then
        objection = string.format("version %d", version)
    elseif lease_state < LEASE.HELD or lease_state > LEASE.RECOVERING then
        objection = string.format("state %d", lease_state)
    else
        objection = tag_objection(body, flags) or freshness_objection(nonce, sequence, epoch)
    end
    if objection then
        refuse(objection)
    else
        accept(now, chan, stamp, lease_state, commander, nonce, sequence, epoch, ttl_ms)
    end
    return key.required and 2 or 1
end

-- MAV_CMD_SCRIPTING would stop this script. The firmware ignores it without an answer once it is blocked; answer here.
local function read_command(msg, chan, crc, magic, len, msgid, sysid, compid)
    if string.unpack("<I2", msg, 41) ~= MAV.CMD_SCRIPTING then
        return 0
    end
    if not crc_fits(msg, magic, len, msgid, crc) then
        return 1
    end
    mavlink:send_chan(chan, MAV.COMMAND_ACK, string.pack("<I2BBi4BB", MAV.CMD_SCRIPTING, MAV.RESULT_DENIED, 0, 0,
                                                     sysid, compid))
    tampering.seen = true
    say(MAV_SEVERITY.WARNING, "command", 10000, string.format("scripting command of %d/%d denied", sysid, compid))
    return 1
end

local function read_frame(now, msg, chan, stamp)
    local crc, magic, len, _, _, _, sysid, compid, msgid = string.unpack("<I2BBBBBBBI3", msg)
    if msgid == MAV.TUNNEL then
        if len < MAV.TUNNEL_HEAD_BYTES or string.unpack("<I2", msg, 13) ~= LEASE.TYPE then
            return 0
        end
        return read_lease(now, msg, chan, stamp, crc, magic, len, sysid, compid)
    end
    if msgid == MAV.COMMAND_LONG or msgid == MAV.COMMAND_INT then
        return read_command(msg, chan, crc, magic, len, msgid, sysid, compid)
    end
    return 0
end

-- returns true when frames may be left
local function read_frames(now)
    local sums = 0
    for _ = 1, WORK.FRAMES_PER_CALL do
        local msg, chan, stamp = mavlink:receive_chan()
        if not msg then
            return false
        end
        sums = sums + read_frame(now, msg, chan, stamp)
        if sums >= WORK.SUMS_PER_CALL then
            return true
        end
    end
    return true
end

-- ------------------------------------------------------------------------------------------------ standing orders

local rx_ids = {MAV.TUNNEL, MAV.COMMAND_LONG, MAV.COMMAND_INT}

-- The receive table is common to all scripts, and init() with more ids than its first caller asked for writes past its
-- end: it is called with three only where nobody has called it yet, which receive_chan() tells by raising.
local function take_rx()
    if not pcall(mavlink.receive_chan, mavlink) then
        mavlink:init(WORK.QUEUE_FRAMES, #rx_ids)
    else
        say(MAV_SEVERITY.NOTICE, "shared", 0, "MAVLink rx was in use before")
    end
end

-- Registers again what another script may have wiped. No free entry: take the first one, for the lease alone.
local function assert_registrations(now, at_start)
    for i = 1, #rx_ids do
        local ok, was_missing = pcall(mavlink.register_rx_msgid, mavlink, rx_ids[i])
        if not ok then
            notice_tampering(now, "MAVLink rx taken by another script")
            rx_ids = {MAV.TUNNEL}
            mavlink:init(WORK.QUEUE_FRAMES, 1)
            mavlink:register_rx_msgid(MAV.TUNNEL)
            break
        elseif was_missing and not at_start then
            notice_tampering(now, "MAVLink rx was reset by a script")
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

-- The new station has to be heard within FS_GCS_TIMEOUT of this: the firmware goes on counting from the old one's last
-- heartbeat. Firmware that accepts a range of ids has it closed, or stations between the two would count as well.
local function follow_commander()
    if not config.sysid_sw or state ~= STATE.LIVE or lease.commander == 0 then
        return
    end
    local present = param:get(gcs_id.name)
    local high = param:get("MAV_GCS_SYSID_HI")
    local known = gcs_id.set == lease.commander and gcs_id.epoch == lease.epoch and gcs_id.nonce == lease.nonce
    if present == lease.commander and not (high and high > 0) then
        gcs_id.set, gcs_id.epoch, gcs_id.nonce = lease.commander, lease.epoch, lease.nonce
        return
    end
    if known then
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

local firmware = {major=0, minor=0}
pcall(function()
    firmware.major, firmware.minor = FWVersion:major(), FWVersion:minor()
end)

local function status_flags()
    local flags = 0
    if loss.active and craft.armed and not loss.stands_back then flags = flags | 1 end
    if craft.armed then flags = flags | 2 end
    if craft.flying then flags = flags | 4 end
    if tampering.seen then flags = flags | 8 end
    return flags
end

-- what makes a status go out at once, and a log record with it
local sent = {state=-1, action=-1, flags=-1, epoch=0, nonce=0}

local function report(now)
    local flags = status_flags()
    local changed = sent.state ~= state or sent.action ~= loss.action or sent.flags ~= flags or
        sent.epoch ~= lease.epoch or sent.nonce ~= lease.nonce
    if not changed and elapsed(now, since.status) < MS.STATUS then
        return false
    end
    local chan = config.chan
    if chan < 0 then
        chan = lease.chan           -- -1 until a lease has come: nobody to tell
    end
    if chan >= 0 then
        local answer = string.pack("<I2BBBBBBBI4I4I4I2BB", STATUS.TYPE, own_sysid, config.compid, STATUS.BYTES,
                                   STATUS.VERSION, state, loss.action, flags, lease.nonce, lease.sequence, lease.epoch,
                                   refused.count, firmware.major, firmware.minor)
        if not mavlink:send_chan(chan, MAV.TUNNEL, answer .. string.rep("\0", MAV.TUNNEL_BYTES - #answer)) then
            return false            -- no room on the link: next call
        end
    end
    sent.state, sent.action, sent.flags, sent.epoch, sent.nonce = state, loss.action, flags, lease.epoch, lease.nonce
    since.status = now
    return changed
end

local function log(now)
    if not logger or not logger.write then
        return
    end
    local age_ms = lease.seen and elapsed(now, lease.at) or 0
    logger:write("HNDO", "St,Ac,Fl,Cmd,LSt,Ep,Seq,Age,Rej", "BBBBBIIIH", "-------s-", "-------C-", state, loss.action,
                 status_flags(), lease.commander, lease.state, lease.epoch, lease.sequence, age_ms, refused.count)
end

local function second(now)
    own_sysid = math.floor(param:get("MAV_SYSID") or param:get("SYSID_THISMAV") or 1)
    assert_registrations(now, false)
    follow_commander()
end

local announced = 0

local function announce_commander()
    local commander = state == STATE.LIVE and lease.commander or 0
    if commander ~= announced and commander ~= 0 then
        say(MAV_SEVERITY.INFO, "commander", 500, string.format("lease live, %d commands", commander))
    end
    announced = commander
end

local function housekeeping(now)
    judge(now)
    permit_arming(now)
    announce_commander()
    if gcs_id.epoch ~= lease.epoch or gcs_id.nonce ~= lease.nonce or gcs_id.set ~= lease.commander then
        follow_commander()
    end
    local changed = report(now)
    local due = elapsed(now, since.second) >= MS.SECOND
    if due then
        since.second = now
    end
    if changed or due then
        log(now)
    end
    if due then
        second(now)
    end
end

-- ------------------------------------------------------------------------------------------------ running

local function protected(f, now)
    local ok, answer = pcall(f, now)
    if ok then
        return true, answer
    end
    pcall(say, MAV_SEVERITY.ERROR, "fault", 10000, "fault " .. tostring(answer))
    return false, nil
end

local function update()
    local now = clock()
    local stalled = elapsed(now, since.last_run) > MS.STALL
    since.last_run = now
    protected(read_config, now)
    if stalled then
        catch_up = WORK.CATCH_UP_CALLS
    end
    local _, more
    if catch_up > 0 then            -- leases may be waiting, oldest first: hear them all before judging
        _, more = protected(read_frames, now)
        catch_up = more and catch_up - 1 or 0
    end
    if catch_up == 0 then
        if not protected(enforce, now) then
            protected(last_resort, now)
        end
        if not stalled then
            _, more = protected(read_frames, now)
        end
    end
    protected(housekeeping, now)
    if more then
        return update, MS.BUSY
    end
    return update, MS.UPDATE
end

read_key()
take_rx()
assert_registrations(since.start, true)
own_sysid = math.floor(param:get("MAV_SYSID") or param:get("SYSID_THISMAV") or 1)
say(MAV_SEVERITY.INFO, "loaded", 0, "handover guard " .. TEXT.VERSION .. (key.required and " loaded, key" or " loaded"))

return update, MS.UPDATE
