"""The bridge as a node: real DDS on one side, MAVLink over UDP with the simulated PX4 behind."""

import contextlib
import signal
import threading
import time

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Quaternion
from pymavlink.dialects.v20 import common as mav
from rclpy.executors import SingleThreadedExecutor
from reports import finding, heard
from std_srvs.srv import SetBool, Trigger

from in_time import in_time
from modified_px4 import ModifiedPx4
from ros_bench import point
from tombo_bag.topics import BATTERY, DIAGNOSTICS, IMU, MOCAP_POSE, ODOMETRY, PX4_STATUS, SETPOINT
from tombo_flight.suite.px4_connection import free_udp_port
from tombo_msgs.msg import MissionStatus, PositionSetpoint
from tombo_px4.link.mavlink_link import Link
from tombo_px4.modes import AUTO_LAND, OFFBOARD
from tombo_px4.protocol.requests import ParameterServer
from tombo_ros.conversion import array, to_ns, to_time

MS, SECOND = 1_000_000, 1_000_000_000
NODE = "tombo_px4.px4_bridge_node"


class Px4Thread:
    """The simulated PX4 at the other end of a UDP link, in a thread of its own."""

    def __init__(self, port, system=1, **parameters):
        url = f"udpout://127.0.0.1:{port}"
        link = Link(url, system=system, component=1, clock=time.time_ns)
        self.px4 = ModifiedPx4(time.time_ns(), link, MAV_SYS_ID=system, **parameters)
        self.lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.is_set():
            with self.lock:
                self.px4.fly(time.time_ns())
            self.px4.link.wait(0.002)

    def close(self):
        self._stop.set()
        self._thread.join(5.0)
        self.px4.link.close()


class Lab:
    """Motion capture at 50 Hz and a mission, around the node and the vehicle."""

    def __init__(self, world, start, *more, system=1, parameters=()):
        self.world = world
        port = free_udp_port()
        self.vehicle = Px4Thread(port, system, **dict(parameters))
        self.phase, self.goal = MissionStatus.IDLE, self.px4.place
        self.captures = []
        world.subscribe(PX4_STATUS, DIAGNOSTICS, ODOMETRY, IMU, BATTERY)
        url = f"link.url:=udpin://127.0.0.1:{port}"
        arguments = [url, "px4.axes_evidence:=simulated", *more]
        self.node = start(NODE, *(a for p in arguments for a in ("-p", p)))
        world.meet(MOCAP_POSE, SETPOINT, PX4_STATUS)
        self._due_ns = 0
        self._rng = np.random.default_rng(0)

    @property
    def px4(self):
        return self.vehicle.px4

    def set_parameter(self, name, value):
        """As a ground station does it: PX4 sends it to the others."""
        self.px4.table.store(name, value)
        self.px4.send(ParameterServer(self.px4.table).value(name)[0])

    def publish(self):
        """A pose captured 15 ms ago and a set point, if it is time for them."""
        now = time.time_ns()
        if now - self._due_ns < 20 * MS:
            return
        self._due_ns = now
        captured = now - 15 * MS
        pose = PoseStamped()
        pose.header.stamp, pose.header.frame_id = to_time(captured), "map"
        pose.pose.position = point(self.px4.place + self._rng.normal(0, 0.0005, 3))
        x, y, z, w = self.px4.attitude.tolist()
        pose.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
        self.captures.append(captured)
        self.world.publish(MOCAP_POSE, pose)
        wish = PositionSetpoint(phase=self.phase)
        wish.header.stamp, wish.header.frame_id = to_time(now), "map"
        wish.position = point(self.goal)
        self.world.publish(SETPOINT, wish)

    def until(self, condition, patience_s=180.0):
        """Wait for a status that meets a condition."""
        since = max(len(self.world.heard[PX4_STATUS.name]) - 1, 0)
        return self.world.wait_for(
            PX4_STATUS, condition, meanwhile=self.publish, since=since, patience_s=patience_s
        )

    def run(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.publish()
            self.world.hear()
            time.sleep(0.002)

    def take_off(self):
        self.until(lambda s: s.ready)
        self.phase, self.goal = MissionStatus.TAKEOFF, np.array([0.0, 0.0, 1.0])
        self.until(lambda s: s.armed and s.offboard and s.landed_state == s.IN_AIR)
        self.phase = MissionStatus.HOVER

    def call(self, name, kind=Trigger, **request):
        """Call a service while the world goes on; return its answer."""
        client = self.world.node.create_client(kind, name)
        assert client.wait_for_service(60.0)
        executor = SingleThreadedExecutor(context=self.world.node.context)
        executor.add_node(self.world.node)
        try:
            future = client.call_async(kind.Request(**request))
            end = time.monotonic() + 60.0
            while not future.done():
                assert time.monotonic() < end, f"no answer from {name}"
                executor.spin_once(timeout_sec=0.005)
                self.publish()
            return future.result()
        finally:
            executor.remove_node(self.world.node)
            executor.shutdown()
            self.world.node.destroy_client(client)

    def figure(self, name):
        """The newest value of the node's diagnostics."""
        for report in reversed(self.world.heard[DIAGNOSTICS.name]):
            for status in report.status:
                if status.name == "px4_bridge":
                    return {v.key: v.value for v in status.values}[name]
        raise AssertionError("no diagnostics")


@pytest.fixture
def lab(world, start):
    with contextlib.ExitStack() as stack:

        def make(*more, **others):
            made = Lab(world, start, *more, **others)
            stack.callback(made.vehicle.close)
            return made

        yield make


@pytest.mark.real_time
def test_a_flight_with_stamps_that_are_right_on_both_sides(lab, world):
    lab = lab()
    lab.take_off()
    assert lab.px4.mode == OFFBOARD
    world.heard[ODOMETRY.name].clear()
    lab.run(2.0)
    # PX4's side: when each pose was captured, as it understands it
    late = lab.px4.stamps[-50:]
    off = [min(abs(captured - c) for c in lab.captures) for captured, _ in late]
    found = world.heard[ODOMETRY.name]
    ages = [time.time_ns() - to_ns(m.header.stamp) for m in found[-3:]]
    stamps = np.diff([to_ns(m.header.stamp) for m in found])
    with in_time():
        assert np.median(off) < 1 * MS
        assert max(off) < 2 * MS
        # our side: the clock of PX4
        assert abs(int(lab.figure("timesync_offset_ns")) + lab.px4.ahead_ns) < 3 * MS
        assert len(found) > 60
        assert all(0 < age < 2 * SECOND for age in ages)
        assert np.median(stamps) == pytest.approx(10 * MS, rel=0.2)
    assert found[-1].header.frame_id == "map" and found[-1].child_frame_id == "base_link"
    # it stays low until the axes have shown, or the time for that is over
    there = np.array([0.0, 0.0, 1.0])
    world.wait_for(
        ODOMETRY,
        lambda m: np.abs(array(m.pose.pose.position) - there).max() < 0.1,
        meanwhile=lab.publish,
    )
    accel = array(heard(world, IMU).linear_acceleration)
    assert accel == pytest.approx([0, 0, 9.81], abs=2.0)
    battery = heard(world, BATTERY)
    assert battery.voltage == pytest.approx(12.6, abs=0.4) and battery.current <= 0.0

    answer = lab.call("px4/hold")  # without a global position PX4 refuses its own
    assert answer.success and "set points hold it" in answer.message
    lab.until(lambda s: s.stage == "mode set by another station")
    answer = lab.call("px4/offboard")
    assert answer.success, answer.message
    lab.until(lambda s: s.offboard)

    lab.phase = MissionStatus.LAND
    lab.until(lambda s: s.mode == "land")
    lab.until(lambda s: not s.armed)

    answer = lab.call("px4/takeoff")
    assert answer.success, answer.message
    lab.until(lambda s: s.armed and s.mode == "takeoff" and not s.offboard)
    answer = lab.call("px4/kill")
    assert answer.success, answer.message
    lab.until(lambda s: not s.armed)
    assert lab.node.end() == 0


def test_a_refusal_is_answered_with_px4s_own_words(lab, world):
    lab = lab()
    lab.until(lambda s: s.ready)
    assert not world.heard[ODOMETRY.name], "the mission begins with the first: it must be good"
    with lab.vehicle.lock:
        lab.px4.refuses[mav.MAV_CMD_COMPONENT_ARM_DISARM] = 1
    answer = lab.call("px4/arm", SetBool, data=True)
    assert not answer.success
    assert "temporarily rejected: 'Arming denied: Resolve system" in answer.message
    with lab.vehicle.lock:
        lab.set_parameter("EKF2_EV_CTRL", 0)
    lab.until(lambda s: not s.ready)
    answer = lab.call("px4/arm", SetBool, data=True)
    assert (
        answer.message == "position is not fused: EKF2_EV_CTRL is 0, without bit 0; set it to 11"
    )
    assert "EKF2_EV_CTRL" in finding(world, "px4_bridge", "check.not_fused", meanwhile=lab.publish)
    with lab.vehicle.lock:
        lab.px4.silent = True
    finding(world, "px4_bridge", "link_lost", meanwhile=lab.publish)
    answer = lab.call("px4/land")
    assert not answer.success and "no heartbeat" in answer.message


@pytest.mark.real_time
def test_ended_while_offboard_holds_it_lands_with_poses_to_the_end(lab, world):
    lab = lab()
    lab.take_off()
    assert lab.call("px4/hold").success  # by set points of the place it is at
    lab.until(lambda s: s.mode == "offboard" and s.stage == "mode set by another station")
    lab.node.process.send_signal(signal.SIGINT)
    end = time.monotonic() + 60.0
    modes = []
    while lab.node.process.poll() is None and time.monotonic() < end:
        lab.run(0.05)
        modes += [lab.px4.mode] if lab.px4.armed else []  # disarmed it has another mode again

    assert lab.node.process.returncode == 0, lab.node.output
    assert modes[-1] == AUTO_LAND and not lab.px4.armed
    with in_time():
        assert lab.captures[-1] - lab.px4.stamps[-1][0] < 500 * MS
