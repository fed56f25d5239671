"""A way to a store on which requests fail as with a store that is too busy."""

from __future__ import annotations

import random
import socket
import socketserver
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

BUSY = b"<Error><Code>SlowDown</Code><Message>Reduce your request rate.</Message></Error>"


@contextmanager
def proxy(upstream: int, percent: int, seed: int) -> Iterator[tuple[int, Counter[str]]]:
    """Forward requests to a port, except for so many percent of them; most of these are answered 503, the others broken off.

    Yields the port of the proxy, and the counts of what happened: `all`, `busy` (answered 503), `broken`.
    """
    seen: Counter[str] = Counter()
    chance, lock = random.Random(seed), threading.Lock()

    class OneRequest(socketserver.StreamRequestHandler):
        """One request and its response; then the connection is closed."""

        def handle(self) -> None:
            head, length = b"", 0
            while (line := self.rfile.readline()) != b"\r\n":
                if not line:
                    return
                name, _, value = line.partition(b":")
                if name.lower() == b"content-length":
                    length = int(value)
                head += line
            body = self.rfile.read(length)
            if len(body) < length:
                return
            with lock:
                seen["all"] += 1
                fails, kind = chance.randrange(100) < percent, chance.randrange(10)
                if fails:
                    seen["busy" if kind < 8 else "broken"] += 1
            if fails and kind < 8:
                status = b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: %d\r\nconnection: close\r\n\r\n"
                self.wfile.write(status % len(BUSY) + BUSY)
                return
            with socket.create_connection(("127.0.0.1", upstream)) as far:
                far.sendall(head + b"connection: close\r\n\r\n" + body)
                answer = b"".join(iter(lambda: far.recv(1 << 16), b""))
            self.wfile.write(answer[: len(answer) // 2] if fails else answer)

    class Server(socketserver.ThreadingTCPServer):
        """Clients that are killed break off their connections; that is no error here."""

        daemon_threads = True
        allow_reuse_address = True
        request_queue_size = 128

        def handle_error(self, request: object, client_address: object) -> None:
            """Ignore it; the client repeats the request."""

    with Server(("127.0.0.1", 0), OneRequest) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server.server_address[1], seen
        finally:
            server.shutdown()
            thread.join()
