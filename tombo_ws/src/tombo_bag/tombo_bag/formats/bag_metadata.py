"""The `metadata.yaml` of a rosbag2 bag folder, version 9 (ROS 2 Jazzy)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from tombo_bag.qos import Qos
from tombo_dynamics.yaml_text import parse_yaml

VERSION = 9
FILE_NAME = "metadata.yaml"
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


@dataclass(frozen=True)
class TopicEntry:
    """One topic of a bag: name, message type and its hash, what its publisher offered."""

    name: str
    typename: str
    type_hash: str
    qos: Qos
    messages: int


@dataclass(frozen=True)
class FileEntry:
    """One file of a bag: name in the folder, log times of first and last message, their number."""

    name: str
    first_ns: int
    last_ns: int
    messages: int


@dataclass(frozen=True)
class BagMetadata:
    """What a bag holds.

    Attributes:
        files: in order.
        topics: of the whole bag.
        custom: further values, free of choice.
    """

    files: tuple[FileEntry, ...]
    topics: tuple[TopicEntry, ...]
    custom: Mapping[str, str] = field(default_factory=dict)

    def information(self) -> dict[str, Any]:
        """Return what stands under `rosbag2_bagfile_information`."""
        filled = [file for file in self.files if file.messages]
        first = min((file.first_ns for file in filled), default=0)
        last = max((file.last_ns for file in filled), default=0)
        return {
            "version": VERSION,
            "storage_identifier": "mcap",
            **_span(first, last),
            "message_count": sum(file.messages for file in self.files),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.typename,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": parse_yaml(topic.qos.as_yaml(), topic.name),
                        "type_description_hash": topic.type_hash,
                    },
                    "message_count": topic.messages,
                }
                for topic in self.topics
            ],
            # chunks inside the files are compressed, which is no concern of rosbag2's
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.name for file in self.files],
            "files": [
                {
                    "path": file.name,
                    **_span(file.first_ns, file.last_ns),
                    "message_count": file.messages,
                }
                for file in self.files
            ],
            "custom_data": dict(self.custom) or None,
            "ros_distro": "jazzy",
        }

    def as_record(self) -> dict[str, str]:
        """Return the metadata record `rosbag2` that stands in each file too."""
        return {"serialized_metadata": _yaml(self.information())}

    def write(self, folder: Path) -> None:
        """Write `metadata.yaml`, whole or not at all."""
        unfinished = folder / f".{FILE_NAME}"
        text = _yaml({"rosbag2_bagfile_information": self.information()})
        try:
            unfinished.write_text(text, encoding="utf-8")
            os.replace(unfinished, folder / FILE_NAME)
        except OSError:
            unfinished.unlink(missing_ok=True)
            raise


def _span(first_ns: int, last_ns: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
    }


def _yaml(content: Mapping[str, Any]) -> str:
    text: str = yaml.dump(content, Dumper=_DUMPER, sort_keys=False, allow_unicode=True, width=1000)
    return text
