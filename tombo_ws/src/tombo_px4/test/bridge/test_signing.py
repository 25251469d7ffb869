"""Signatures: who has no key stays out, and nothing that was said can be said again."""

import pytest
from mavlink_packets import encoder, heartbeat

from tombo_dynamics.errors import InputError
from tombo_px4.link.framing import FrameCounts, frames_of
from tombo_px4.link.signing import SignatureVerifier, check_key, read_key, timestamp_of

KEY = bytes(range(1, 33))
OTHER = bytes(range(2, 34))
NOW_NS = 1_800_000_000 * 10**9
NOW = timestamp_of(NOW_NS)


def signed(timestamp, key=KEY, system=1, component=1, link_id=0):
    mav = encoder(system, component, key)
    mav.signing.timestamp = timestamp
    mav.signing.link_id = link_id
    (frame,) = frames_of(heartbeat(1, mav), FrameCounts())
    return frame


def test_timestamps_count_ten_microseconds_since_2015():
    assert timestamp_of(1_420_070_400 * 10**9) == 0
    assert timestamp_of(1_420_070_401 * 10**9) == 100_000
    assert timestamp_of(0) == 0
    assert timestamp_of(2**80) == 2**48 - 1


def test_any_changed_byte_breaks_the_signature():
    frame = signed(NOW + 1)
    for position in range(1, len(frame.data)):
        data = bytearray(frame.data)
        data[position] ^= 0x10
        gate = SignatureVerifier(KEY, NOW_NS)
        assert gate.refusal(frame._replace(data=bytes(data))) == "bad_signature", position


def test_every_sender_and_link_has_timestamps_of_its_own():
    gate = SignatureVerifier(KEY, NOW_NS)
    assert gate.refusal(signed(NOW + 9)) == ""
    for other in ({"system": 2}, {"component": 2}, {"link_id": 2}):
        assert gate.refusal(signed(NOW + 3, **other)) == ""
        assert gate.refusal(signed(NOW + 3, **other)) == "replayed"


def test_what_was_recorded_before_we_listened_is_refused():
    gate = SignatureVerifier(KEY, NOW_NS)
    assert gate.refusal(signed(NOW - 1)) == "replayed"
    assert gate.refusal(signed(NOW)) == ""


def test_a_forged_timestamp_does_not_shut_the_partner_out():
    gate = SignatureVerifier(KEY, NOW_NS)
    assert gate.refusal(signed(2**48 - 1, OTHER)) == "bad_signature"
    assert gate.refusal(signed(NOW + 1)) == ""
    assert gate.next_timestamp(NOW_NS) == NOW + 2


def test_a_partner_whose_clock_is_behind_takes_over_our_time():
    """pymavlink plays the partner: by the protocol it continues from the newest it has heard."""
    gate = SignatureVerifier(KEY, NOW_NS)
    partner = encoder(1, 1, KEY)
    partner.signing.timestamp = timestamp_of(NOW_NS - 3600 * 10**9)
    (early,) = frames_of(heartbeat(1, partner), FrameCounts())
    assert gate.refusal(early) == "replayed"
    partner.decode(bytearray(signed(gate.next_timestamp(NOW_NS), system=245).data))
    partner.signing.timestamp += 1
    (late,) = frames_of(heartbeat(1, partner), FrameCounts())
    assert gate.refusal(late) == ""


def test_our_timestamps_grow_with_the_clock_and_without_it():
    gate = SignatureVerifier(KEY, NOW_NS)
    assert gate.next_timestamp(NOW_NS) == NOW + 1
    assert gate.next_timestamp(NOW_NS - 10**12) == NOW + 2
    assert gate.next_timestamp(NOW_NS + 10**9) == NOW + 100_000
    gate.refusal(signed(NOW + 500_000))
    assert gate.next_timestamp(NOW_NS) == NOW + 500_001
    assert gate.next_timestamp(2**80) == gate.next_timestamp(2**80) == 2**48 - 1  # no wrap


@pytest.mark.parametrize("content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"])
def test_a_key_is_read_as_bytes_or_digits(tmp_path, content):
    path = tmp_path / "key"
    path.write_bytes(content)
    path.chmod(0o600)
    assert read_key(path) == (KEY, "")


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o622])
def test_a_key_that_others_may_read_is_warned_of(tmp_path, mode):
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(mode)
    key, warning = read_key(path)
    assert key == KEY
    assert str(path) in warning and "chmod 600" in warning


@pytest.mark.parametrize(
    "content",
    [b"", KEY[:-1], KEY + b"\n", bytes(32), b"0" * 64, KEY.hex().encode()[:-1], b"\xff" * 64],
)
def test_what_is_no_key_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "key"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"key '.*' is no key; accepted: a file of 32 bytes") as e:
        read_key(path)
    assert "\n" not in str(e.value)


def test_a_key_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_key(tmp_path / "none")
    with pytest.raises(InputError, match="directory"):
        read_key(tmp_path)
    with pytest.raises(InputError, match="accepted"):
        check_key(b"short")
