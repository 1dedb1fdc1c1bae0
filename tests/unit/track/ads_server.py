"""A stand-in for a PLC: AMS/TCP with what a subscription needs, sending recorded samples with their time stamps.

Frames after Beckhoff, TwinCAT ADS, AMS/TCP packet and ADS commands (infosys.beckhoff.com, TF6020 and TC3 ADS).
"""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Sequence
from contextlib import suppress

PORT = 48898
READ_STATE, WRITE, ADD, DELETE, NOTIFICATION, READ_WRITE = 4, 3, 6, 7, 8, 9
HANDLE_BY_NAME, INFO_BY_NAME = 0xF003, 0xF009
RUN, CONFIG, NO_SYMBOL, LREAL = 5, 15, 0x710, 5
STAMP = 133_500_000_000_000_000  # 100 ns since 1601: some day in January 2024


class StandIn(threading.Thread):
    """Serve one client after the other; each gets the samples that the one before it did not.

    Parameters
    ----------
    host : str
        Address of the loopback.
    symbols : sequence of str
    samples : sequence of (float, sequence of float)
        Time in s, and a value per symbol.
    cut : int
        Samples after which the connection is closed for the first time; 0 for never.
    state : int
        ADS state that is answered.
    """

    def __init__(
        self, host: str, symbols: Sequence[str], samples: Sequence[tuple[float, Sequence[float]]], *,
        cut: int = 0, state: int = RUN,
    ) -> None:  # fmt: skip
        super().__init__(daemon=True)
        self.symbols, self.samples, self.cut, self.state = list(symbols), list(samples), cut, state
        self.sent = 0
        self.listening = socket.create_server((host, PORT))
        self.handles: list[int] = []

    def run(self) -> None:
        with suppress(OSError):  # the listening socket is closed at the end
            while True:
                client, _ = self.listening.accept()
                with client, suppress(OSError):
                    self.serve(client)
                self.handles = []

    def close(self) -> None:
        with suppress(OSError):
            self.listening.shutdown(socket.SHUT_RDWR)
        self.listening.close()
        self.join(5.0)

    def serve(self, client: socket.socket) -> None:
        while (head := client.recv(6, socket.MSG_WAITALL)) and len(head) == 6:
            packet = client.recv(struct.unpack("<2xI", head)[0], socket.MSG_WAITALL)
            target, source = packet[:8], packet[8:16]
            command, invoke = struct.unpack("<H", packet[16:18])[0], packet[28:32]
            client.sendall(frame(source, target, command, 5, invoke, self.answer(command, packet[32:])))
            # a client knows a handle only after the answer: what comes at once it may drop. Here it has asked again
            if command == READ_STATE and len(self.handles) == len(self.symbols):
                self.send(client, source, target)
                if self.cut:
                    self.cut = 0
                    return

    def answer(self, command: int, data: bytes) -> bytes:
        if command == READ_STATE:
            return struct.pack("<IHH", 0, self.state, 0)
        if command == READ_WRITE:
            group, name = struct.unpack("<I", data[:4])[0], data[16:].rstrip(b"\0").decode()
            if name not in self.symbols:
                return struct.pack("<II", NO_SYMBOL, 0)
            number = self.symbols.index(name)
            content = struct.pack("<I", 100 + number) if group == HANDLE_BY_NAME else symbol(name, number)
            return struct.pack("<II", 0, len(content)) + content
        if command == ADD:
            self.handles.append(struct.unpack("<4xI", data[:8])[0] - 100)
            return struct.pack("<II", 0, len(self.handles))
        return struct.pack("<I", 0)

    def send(self, client: socket.socket, target: bytes, source: bytes) -> None:
        """Send what is left, 50 stamps a packet, all symbols of a stamp together."""
        last = self.cut or len(self.samples)
        while self.sent < last:
            part = self.samples[self.sent : min(self.sent + 50, last)]
            stamps = b"".join(
                struct.pack("<QI", STAMP + round(1e7 * t), len(values))
                + b"".join(
                    struct.pack("<IId", handle, 8, values[number])
                    for handle, number in enumerate(self.handles, start=1)
                )
                for t, values in part
            )
            content = struct.pack("<II", len(stamps) + 4, len(part)) + stamps
            client.sendall(frame(target, source, NOTIFICATION, 4, bytes(4), content))
            self.sent += len(part)


def frame(target: bytes, source: bytes, command: int, flags: int, invoke: bytes, data: bytes) -> bytes:
    """Return a packet: the AMS/TCP header, the AMS header and the data."""
    about = struct.pack("<HHII", command, flags, len(data), 0)
    return struct.pack("<HI", 0, 32 + len(data)) + target + source + about + invoke + data


def symbol(name: str, number: int) -> bytes:
    """Return the entry of an LREAL."""
    words = name.encode() + b"\0" + b"LREAL\0" + b"\0"
    return struct.pack("<IIIIIIHHH", 30 + len(words), 0x4040, 8 * number, 8, LREAL, 0, len(name), 5, 0) + words
