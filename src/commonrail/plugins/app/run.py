"""The app from Python: pages of this machine that calibrate and judge injectors."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

from commonrail.base.arguments import file_path, flag, function, integer
from commonrail.base.errors import ConfigurationError


def app(
    folder: str | Path = "injector-project",
    *,
    port: int = 0,
    opens: bool = True,
    announce: Callable[[str], None] = print,
) -> None:
    """Serve pages that calibrate and judge injectors in the browser, to this machine alone, until Ctrl-C.

    Parameters
    ----------
    folder : str or path
        Project folder: new, or from an earlier session.
    port : int
        Port of this machine; any free one by default.
    opens : bool
        Open a browser.
    announce : function of str
        Called with the address.

    Raises
    ------
    ConfigurationError
        If NiceGUI is missing, or an argument is of another kind.
    """
    if importlib.util.find_spec("nicegui") is None:
        raise ConfigurationError("The app needs NiceGUI, which is not installed: pip install 'commonrail[app]'.")
    from commonrail.plugins.app.server import listen, serve

    path, port = file_path(folder, "folder"), integer(port, "port", 0, 65535)
    function(announce, "announce")
    listener = listen(port)
    serve(path, listener, listener.getsockname()[1], announce, opens=flag(opens, "opens"))
