"""The MAVLink link: transports, framing, signing, messages in and out, clocks."""
