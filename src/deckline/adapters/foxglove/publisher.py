"""One set of ROS 2 messages for an MCAP file and for Foxglove, through the Foxglove SDK."""

from contextlib import ExitStack
from pathlib import Path

import foxglove
from foxglove.mcap import MCAPWriteOptions

from deckline.adapters.ros.encode import Encoder
from deckline.adapters.ros.messages import Message, diagnostics, frame_messages, guidance_messages
from deckline.config import RunConfig
from deckline.flight import FrameResult
from deckline.live.datagrams import parse_host_port
from deckline.recording.images import encode_image
from deckline.report.records import Record

DEFAULT = "127.0.0.1:8765"  # Foxglove's own port
PICTURE, QUALITY = "jpeg", 85


class Publisher:
    """Sends messages to all that are open, by a channel for each topic.

    Args:
        mcap: new file of the profile ros2; None: none.
        address: HOST:PORT to listen on for Foxglove; None: nowhere.
        overwrite: replace the file.

    Raises:
        ValueError: the file is there already, or nobody can listen there.
        OSError: the file cannot be written.
    """

    def __init__(self, mcap: Path | None, address: str | None, overwrite: bool = False) -> None:
        self._encoder, self._context = Encoder(), foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._stack = ExitStack()
        self.url = ""
        if address is not None:
            host, port = parse_host_port(f"ws://{address.removeprefix('ws://')}", ("ws",))
            try:
                server = foxglove.start_server(name="deckline", host=host, port=port, context=self._context)
            except RuntimeError as error:
                raise ValueError(f"--foxglove {address}: cannot listen there: {error}") from None
            self._stack.callback(server.stop)
            self.url = f"ws://{host}:{server.port}"
        if mcap is not None:
            options = MCAPWriteOptions(profile="ros2")
            try:
                opened = foxglove.open_mcap(
                    mcap, allow_overwrite=overwrite, context=self._context, writer_options=options
                )
            except FileExistsError:
                self._stack.close()
                raise ValueError(f"{mcap} is there already: choose another file, or --overwrite") from None
            self._stack.callback(opened.close)

    def send(self, messages: list[Message], time_s: float) -> None:
        """Send messages, logged at a time of their own clock."""
        for topic, kind, values in messages:
            if topic not in self._channels:
                schema = foxglove.Schema(name=kind, encoding="ros2msg", data=self._encoder.definition(kind))
                self._channels[topic] = foxglove.Channel(
                    topic, schema=schema, message_encoding="cdr", context=self._context
                )
            self._channels[topic].log(self._encoder(kind, values), log_time=max(round(1e9 * time_s), 0))

    def close(self) -> None:
        self._stack.close()


class FlightPublisher:
    """A view of a flight: every record becomes messages at the frame's time; call it in one thread.

    Args:
        publisher: gets them.
        source: what people call the source.
        config: of the flight.
    """

    def __init__(self, publisher: Publisher, source: str, config: RunConfig) -> None:
        self._publisher, self._source, self._config = publisher, source, config
        self._time_s: float | None = None  # of the last frame

    def __call__(self, result: FrameResult | None, record: Record) -> None:
        """Send what a frame showed and what it is worth; without a frame, only that.

        A live message without a frame counts from the last frame; before the first one there is no time to give it.
        """
        if result is not None:
            frame = result.frame
            picture = encode_image(frame.image_rgb, PICTURE, QUALITY)
            messages = frame_messages(frame, picture, PICTURE) + guidance_messages(result, record, self._config)
            time_s = self._time_s = frame.time_s
        elif self._time_s is not None:
            messages, time_s = [], self._time_s + (record.get("live", {}).get("age_s") or 0.0)
        else:
            return
        self._publisher.send([*messages, diagnostics(record, self._source, time_s)], time_s)
