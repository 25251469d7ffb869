"""The `metadata.yaml` of a rosbag2 bag folder, version 9 (ROS 2 Jazzy)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tombo_bag.qos import Qos
from tombo_bag.schemas import type_hash
from tombo_dynamics.yaml_text import parse_yaml

VERSION = 9
FILE_NAME = "metadata.yaml"


@dataclass(frozen=True)
class TopicEntry:
    """One topic of a bag: name, message type, what its publisher offered, number of messages."""

    name: str
    typename: str
    qos: Qos
    messages: int


def write_metadata(
    file: Path, span_ns: tuple[int, int], topics: Sequence[TopicEntry], custom: Mapping[str, str]
) -> None:
    """Write `metadata.yaml` next to the file of a bag, whole or not at all.

    Args:
        file: of the bag.
        span_ns: log times of its first and last message.
        topics: of the bag.
        custom: further values, free of choice.
    """
    first_ns, last_ns = span_ns
    span = {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "message_count": sum(topic.messages for topic in topics),
    }
    information = {
        "version": VERSION,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": [_topic(topic) for topic in topics],
        # empty: rosbag2 does not count the compression of chunks inside the files
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name],
        "files": [{"path": file.name, **span}],
        "custom_data": dict(custom) or None,
        "ros_distro": "jazzy",
    }
    text = yaml.safe_dump(
        {"rosbag2_bagfile_information": information}, sort_keys=False, allow_unicode=True
    )
    unfinished = file.with_name(f".{FILE_NAME}")
    try:
        unfinished.write_text(text, encoding="utf-8")
        os.replace(unfinished, file.with_name(FILE_NAME))
    except OSError:
        unfinished.unlink(missing_ok=True)
        raise


def _topic(topic: TopicEntry) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.typename,
            "serialization_format": "cdr",
            "offered_qos_profiles": parse_yaml(topic.qos.as_yaml(), topic.name),
            "type_description_hash": type_hash(topic.typename),
        },
        "message_count": topic.messages,
    }
