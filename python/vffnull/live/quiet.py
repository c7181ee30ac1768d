"""What viser says and should not: where it is, and that a computer has no graphics card."""

from __future__ import annotations

import io
from contextlib import redirect_stdout

import viser


def quiet() -> redirect_stdout[io.StringIO]:
    """Hold back what viser prints: whoever opens the page says where it is."""
    return redirect_stdout(io.StringIO())


def uncover(client: viser.ClientHandle) -> None:
    """Close what viser says where there is no graphics card: it stays, and hides what is to be dragged."""
    notice = viser._messages.RemoveNotificationMessage("webgl-software-rendering")
    client._websock_connection.queue_message(notice)
