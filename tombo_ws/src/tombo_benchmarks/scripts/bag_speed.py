"""How long writing and reading a flight's MCAP file takes, beside the library's own writer.

    python bag_speed.py

The flight is made up of random walks, 40 s with every topic: it compresses no better than a real
one. Times are the best of some runs, but for the first one, which loads the message types.
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

sys.path.insert(0, str(Path(__file__).parents[4] / "tombo_ws/src/tombo_bag/test"))

from synthetic_flight import synthetic_flight

from tombo_bag.flight import Flight

FLIGHT_S = 40
RUNS = 5
LIMIT_S = 0.4


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")


def seconds(action: Callable[[], object]) -> float:
    """Time one call [s]."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def write(path: Path, flight: Flight, compression: str = "zstd") -> None:
    """Write the flight as `tombo fly` does."""
    from tombo_bag.flight_topics import write_flight
    from tombo_bag.formats.mcap_sink import McapSink

    with McapSink(path, compression=compression) as sink:
        write_flight(sink, flight)


def main() -> None:
    """Measure and print."""
    flight = synthetic_flight(FLIGHT_S * 1000)
    path = Path(tempfile.mkdtemp()) / "flight.mcap"
    first = seconds(lambda: write(path, flight))

    from tombo_bag.formats.mcap_sink import McapSink
    from tombo_bag.formats.reader import Bag
    from tombo_bag.recording import Recording

    bag = Bag(path)
    number = sum(topic.count for topic in bag.topics.values())
    say(f"{FLIGHT_S} s flight, {len(bag.topics)} topics, {number} messages")
    say(f"first write, with imports and message types: {1e3 * first:.0f} ms (limit: 400 ms)")
    say()
    say("| compression | ms | µs a message | MB | times real time |")
    say("|---|---|---|---|---|")
    for compression in ("zstd", "lz4", "none"):
        took = min(seconds(lambda c=compression: write(path, flight, c)) for _ in range(RUNS))
        size = path.stat().st_size / 1e6
        each = 1e6 * took / number
        row = (compression, f"{1e3 * took:.0f}", f"{each:.2f}", f"{size:.1f}")
        say(f"| {' | '.join(row)} | {FLIGHT_S / took:.0f} |")
        if compression == "zstd" and took > LIMIT_S:
            say(f"**slower than the {LIMIT_S} s that recording may take**")

    write(path, flight)
    bag = Bag(path)
    ready = [
        (topic, time_ns, message)
        for topic, raw in bag.messages(bag.topics).items()
        for time_ns, message in zip(raw.log_times_ns.tolist(), raw.messages, strict=True)
    ]
    ready.sort(key=lambda item: item[1])

    def library() -> None:
        writer = Writer(io.BytesIO(), compression=CompressionType.ZSTD)
        writer.start("ros2")
        schema = writer.register_schema("a/msg/B", "ros2msg", b"")
        channels = {topic: writer.register_channel(topic, "cdr", schema) for topic in bag.topics}
        for topic, time_ns, message in ready:
            writer.add_message(channels[topic], time_ns, message, time_ns)
        writer.finish()

    def one_by_one() -> None:
        with McapSink(path.with_name("single.mcap")) as sink:
            channels = {
                topic: sink.add_channel(topic, stream.typename)
                for topic, stream in bag.topics.items()
            }
            for topic, time_ns, message in ready:
                sink.write(channels[topic], message, time_ns)

    say()
    say("The same messages, serialized beforehand, one by one:")
    for name, action in (("mcap library", library), ("McapSink.write", one_by_one)):
        took = min(seconds(action) for _ in range(3))
        say(f"  {name}: {1e3 * took:.0f} ms, {1e6 * took / number:.2f} µs a message")

    def decode() -> None:
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _ in reader.iter_decoded_messages(["/imu/data_raw"]):
                pass

    say()
    say("Reading /imu/data_raw (1 kHz):")
    took = min(seconds(lambda: Recording(path).columns("/imu/data_raw")) for _ in range(RUNS))
    say(f"  as columns: {1e3 * took:.0f} ms, {FLIGHT_S / took:.0f} times real time")
    took = seconds(decode)
    say(f"  mcap_ros2: {1e3 * took:.0f} ms, {FLIGHT_S / took:.0f} times real time")


if __name__ == "__main__":
    main()
