"""As much of PX4 as the bridge's tests need: answers as a real one did, on a clock of its own.

No sockets and no clock: `take` what came, `tick` gives what it says.
"""

import math
import struct

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_px4.frames import enu_from_ned, ned_from_enu, px4_quaternion
from tombo_px4.link.extra_messages import COMPONENT_METADATA, ComponentMetadata, EventMessage
from tombo_px4.link.message_encoder import float_of_int
from tombo_px4.link.timesync import TimeSync
from tombo_px4.modes import AUTO_HOLD, AUTO_LAND, OFFBOARD, custom_mode, mode_of
from tombo_px4.protocol.parameter_protocol import int_of_float

FTP = struct.Struct("<HBBBBBBI")
# as in the file of events of PX4 1.17
DENIED, CHECKS_BEGIN, CHECKS_END = 16910493, 27825120, 18691879
SECOND = 1_000_000_000
GROUND = 0.18
NAN = math.nan
PARAMETERS = {
    "EKF2_EV_CTRL": 11,
    "EKF2_HGT_REF": 3,
    "EKF2_EV_DELAY": 0.0,
    "EKF2_DELAY_MAX": 200.0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_BARO_CTRL": 1,
    "COM_OBL_RC_ACT": 4,
    "COM_DISARM_LAND": 2.0,
    "EKF2_RNG_CTRL": 0,
    "EKF2_MAG_TYPE": 5,
    "SYS_HAS_GPS": 0,
    "MAV_SYS_ID": 1,
    "COM_OF_LOSS_T": 1.0,
    "COM_RCL_EXCEPT": 4,
    "NAV_DLL_ACT": 0,
    "MPC_THR_HOVER": 0.47,
}


class ScriptedPx4:
    """A vehicle that goes where it is told; it estimates from the poses it gets."""

    def __init__(self, now_ns, system=1):
        self.system = system
        self.ahead_ns = 20 * SECOND - now_ns
        """Its clock against the true one."""
        self.place, self.velocity = np.array([0.0, 0.0, GROUND]), np.zeros(3)
        self._felt = 0, np.zeros(3)
        """Time and velocity of the last sample of its accelerometer."""
        self.attitude = np.array([0.0, 0.0, 0.0, 1.0])
        self.failsafe = False
        self.armed, self.mode = False, AUTO_HOLD
        self.refuses = {}
        self.fuses = True
        self.silent = False
        self.mute = set()
        """Messages it does not send."""
        self.parameters = dict(PARAMETERS)
        self.sync = TimeSync()
        self.estimate = None
        self.stamps = []
        """Of each pose: its capture on our clock as PX4 thinks, and its arrival."""
        self.files = {}
        """Path to content of the files that it serves."""
        self.loses_files = False
        self.failing = []
        """Number, severity and modes of each check that fails."""
        self.withholds = self.heard_station = False
        self.sequence = 0
        self._open = b""
        self.targets = []
        self.received = []
        self.goal = None
        self.stream_ns = 0
        self._out, self._asked = [], []
        self._due = {}
        self._now = now_ns
        self._grounded_ns = None
        self._rng = np.random.default_rng(3)

    def boot_ns(self, now_ns):
        return now_ns + self.ahead_ns

    def shift_time(self, by_ns):
        """Follow a change of the clock that the caller counts in."""
        self._now += by_ns
        self.stream_ns += by_ns
        self._due = {name: sent + by_ns for name, sent in self._due.items()}

    @property
    def in_air(self):
        return self.place[2] > GROUND + 0.05

    # --- what comes in ----------------------------------------------------------------------

    def take(self, m, now_ns):
        """Take a message that arrives now."""
        kind = m.get_type()
        self.received.append(m)
        boot = self.boot_ns(now_ns)
        if kind == "TIMESYNC":
            if m.tc1 == 0:
                self._asked.append((m.ts1, boot))
            else:
                self.sync.reply(m.tc1, m.ts1, boot)
        elif kind == "ODOMETRY" or kind == "VISION_POSITION_ESTIMATE":
            self._vision(m, now_ns)
        elif kind.startswith("SET_"):
            self.targets.append(m)
            self.stream_ns = now_ns
            if kind == "SET_POSITION_TARGET_LOCAL_NED":
                self.goal = enu_from_ned([m.x, m.y, m.z])
        elif kind == "COMMAND_LONG":
            self._command(m)
        elif kind == "FILE_TRANSFER_PROTOCOL":
            self._file(bytes(m.payload))
        elif kind == "HEARTBEAT":
            self.heard_station = m.type == mav.MAV_TYPE_GCS
        elif kind == "PARAM_REQUEST_READ":
            self._parameter(m.param_id)
        elif kind == "PARAM_SET":
            old = self.parameters[m.param_id]
            value = m.param_value
            if isinstance(old, int):
                value = int_of_float(value)
            self.parameters[m.param_id] = value
            self._parameter(m.param_id)

    def _vision(self, m, now_ns):
        usec = m.usec if m.get_type() == "VISION_POSITION_ESTIMATE" else m.time_usec
        if not self.sync.converged:
            return
        captured = self.sync.to_local_time(usec * 1000) - self.ahead_ns
        self.stamps.append((captured, now_ns))
        if self.fuses and m.get_type() == "ODOMETRY":
            self.estimate = enu_from_ned([m.x, m.y, m.z])

    def _command(self, m):
        number = m.command
        if number == mav.MAV_CMD_DO_SET_MODE:
            self._ack(number, 0)
        result = self.refuses.get(number, 0)
        self._ack(number, result)
        if result:
            self.say("Arming denied: Resolve system health failures first\t", 2)
            self.tell(DENIED, 2)
        elif number == mav.MAV_CMD_RUN_PREARM_CHECKS:
            self.report_checks()
        elif number == mav.MAV_CMD_REQUEST_MESSAGE and m.param1 == COMPONENT_METADATA:
            if self.files:
                uri = b"mftp://etc/general.json.xz"
                self._out.append(ComponentMetadata(0, 0, uri))
        elif number == mav.MAV_CMD_DO_SET_MODE:
            self.mode = mode_of(int(m.param2) << 16 | int(m.param3) << 24)
        elif number == mav.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = bool(m.param1)
        elif number == mav.MAV_CMD_REQUEST_MESSAGE and m.param1 == 0:
            self._out += self._heartbeat(0)
        elif number == mav.MAV_CMD_REQUEST_MESSAGE and m.param1 == 148:
            version = 1 << 24 | 17 << 16 | 255
            self._out.append(
                mav.MAVLink_autopilot_version_message(
                    0, version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
                )
            )

    def _ack(self, number, result):
        self._out.append(mav.MAVLink_command_ack_message(number, result, 0, 0, 245, 191))

    def tell(self, number, severity, *arguments):
        """Send an event; arguments are pairs of a kind of `struct` and a value."""
        data = b"".join(struct.pack("<" + kind, value) for kind, value in arguments)
        self.sequence += 1
        content = (number, 0, self.sequence, 0, 0, severity, list(data.ljust(40, b"\0")))
        self._out.append(EventMessage(*content))

    def report_checks(self):
        """Send all failed checks of arming."""
        self.tell(CHECKS_BEGIN, 8)
        for number, severity, modes in self.failing:
            self.tell(number, severity, ("I", modes), ("B", 0))
        self.tell(CHECKS_END, 8)

    def _file(self, payload):
        """Answer a request of MAVLink FTP."""
        sequence, _, operation, size, _, _, _, offset = FTP.unpack_from(payload)
        data, answer, back = payload[FTP.size : FTP.size + size], 128, b""
        if self.loses_files and self._rng.random() < 0.3:
            return
        if operation == 4:
            self._open = self.files.get(data.decode())
            answer, back = (129, b"\x0a") if self._open is None else (128, b"")
            back = back or struct.pack("<I", len(self._open))
        elif operation == 5:
            back = self._open[offset : offset + size]
            answer, back = (128, back) if back else (129, b"\x06")
        head = FTP.pack((sequence + 1) % 65536, 0, answer, len(back), operation, 0, 0, offset)
        content = (0, 245, 191, list((head + back).ljust(251, b"\0")))
        self._out.append(mav.MAVLink_file_transfer_protocol_message(*content))

    def say(self, text, severity=6):
        """Send a text, in pieces if it is long; like PX4, only where it hears a ground station."""
        if self.withholds and not self.heard_station:
            return
        data = text.encode()
        if len(data) < 50:
            self._out.append(mav.MAVLink_statustext_message(severity, data))
            return
        for chunk in range(len(data) // 50 + 1):
            part = data[50 * chunk : 50 * chunk + 50]
            self._out.append(mav.MAVLink_statustext_message(severity, part, 77, chunk))

    def _parameter(self, name):
        value = self.parameters.get(name)
        if value is None:
            return
        kind = mav.MAV_PARAM_TYPE_REAL32
        if isinstance(value, int):
            kind = mav.MAV_PARAM_TYPE_INT32
            value = float_of_int(value)
        self._out.append(mav.MAVLink_param_value_message(name.encode(), value, kind, 900, 7))

    # --- what it says -----------------------------------------------------------------------

    def tick(self, now_ns):
        """Go on to now; return the messages it sends."""
        passed = (now_ns - self._now) * 1e-9
        self._now = now_ns
        self._move(passed, now_ns)
        for name, rate in (
            ("HEARTBEAT", 1.0),
            ("ODOMETRY", 50.0),
            ("LOCAL_POSITION_NED", 30.0),
            ("ATTITUDE_QUATERNION", 30.0),
            ("HIGHRES_IMU", 50.0),
            ("EXTENDED_SYS_STATE", 10.0),
            ("ESTIMATOR_STATUS", 5.0),
            ("BATTERY_STATUS", 2.0),
            ("TIMESYNC", 10.0),
        ):
            late = abs(now_ns - self._due.get(name, 0)) >= SECOND / rate
            if late and name not in self.mute:
                self._due[name] = now_ns
                self._out += getattr(self, f"_{name.lower()}")(self.boot_ns(now_ns))
        for asked, arrival in self._asked:
            times = self.sync.answer(0, asked, arrival, self.boot_ns(now_ns))
            self._out.append(mav.MAVLink_timesync_message(*times))
        self._asked.clear()
        out, self._out = self._out, []
        return [] if self.silent else out

    def _move(self, passed, now_ns):
        target = None
        if self.armed and self.mode == OFFBOARD and self.goal is not None:
            target = self.goal
            if now_ns - self.stream_ns > SECOND:
                self.mode = AUTO_HOLD
                self.say("Failsafe activated: no offboard signal", 4)
        elif self.armed and self.mode == AUTO_LAND:
            target = self.place * [1.0, 1.0, 0.0]
        if target is not None:
            wanted = np.clip(2.0 * (target - self.place), -1.5, 1.5)
            self.velocity += np.clip(8.0 * (wanted - self.velocity), -6.0, 6.0) * passed
            self.place = self.place + self.velocity * passed
        if target is None or self.place[2] < GROUND:
            self.velocity = np.zeros(3)
            self.place[2] = max(self.place[2], GROUND)
        if self.armed and self.mode == AUTO_LAND and not self.in_air:
            self._grounded_ns = self._grounded_ns or now_ns
            if now_ns - self._grounded_ns > SECOND // 2:
                self.armed = False
                self.say("Disarmed by landing")
        else:
            self._grounded_ns = None

    def _heartbeat(self, boot):
        base = 0x81 if self.armed else 0x01
        number = custom_mode(self.mode)
        state = mav.MAV_STATE_CRITICAL if self.failsafe else mav.MAV_STATE_ACTIVE
        return [mav.MAVLink_heartbeat_message(2, mav.MAV_AUTOPILOT_PX4, base, number, state, 3)]

    def _odometry(self, boot):
        if self.estimate is None:
            return []
        place, q = ned_from_enu(self.estimate), px4_quaternion(self.attitude)
        covariance = [1e-4 if k in (0, 6, 11, 15, 18, 20) else NAN for k in range(21)]
        moving = 6 * [0]
        return [
            mav.MAVLink_odometry_message(
                boot // 1000, 1, 12, *place, q, *moving, covariance, covariance
            )
        ]

    def _local_position_ned(self, boot):
        if self.estimate is None:
            return []
        place = ned_from_enu(self.estimate)
        return [mav.MAVLink_local_position_ned_message(boot // 1_000_000, *place, 0, 0, 0)]

    def _attitude_quaternion(self, boot):
        q = px4_quaternion(self.attitude)
        return [mav.MAVLink_attitude_quaternion_message(boot // 1_000_000, *q, 0, 0, 0)]

    def _highres_imu(self, boot):
        noise = self._rng.normal(0, 0.01, 6)
        (since, before), self._felt = self._felt, (self._now, self.velocity.copy())
        mean = (self.velocity - before) / max((self._now - since) * 1e-9, 1e-3)
        accel = mean * [1.0, -1.0, -1.0] + [0.0, 0.0, -9.81] + noise[:3]
        gyro = 0.1 * noise[3:]
        return [mav.MAVLink_highres_imu_message(boot // 1000, *accel, *gyro, *7 * [0], 0x3F)]

    def _extended_sys_state(self, boot):
        return [mav.MAVLink_extended_sys_state_message(0, 2 if self.in_air else 1)]

    def _estimator_status(self, boot):
        known = self.estimate is not None
        flags = 1 | (8 | 32 | 256 if known else 0) | (0 if known and self.in_air else 128)
        ratios = (0, 0.1, 0.1, 0, 0, 0)
        return [mav.MAVLink_estimator_status_message(boot // 1000, flags, *ratios, 0, 0)]

    def _battery_status(self, boot):
        cells = [4100, 4090, 4080] + 7 * [0xFFFF]
        return [mav.MAVLink_battery_status_message(0, 0, 0, 2000, cells, 900, 0, 0, 80)]

    def _timesync(self, boot):
        return [mav.MAVLink_timesync_message(*self.sync.request(boot))]
