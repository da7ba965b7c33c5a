"""The systemd units of the daemon: their contents and their paths, for a user or for the machine.

Must not write, start or stop units. The texts are in `systemd/`, with `$name` for the parts that differ.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from string import Template

import msgspec

from bus_cli.units import quoted, unit_folder

OURS = "# Written by bus daemon install."
"""The first line of each unit."""

_KINDS = ("socket", "service")
_NOTIFY_RELOAD = 253
"""The first systemd with Type=notify-reload."""


class Units(msgspec.Struct, frozen=True):
    """The units of one domain. With `user` and `group` they are the machine's units, else the caller's own.

    `config` is the absolute path of busd.toml, or None.
    """

    domain: int = 0
    user: str = ""
    group: str = ""
    config: Path | None = None

    @property
    def name(self) -> str:
        return f"busd-{self.domain}" if self.domain else "busd"

    @property
    def folder(self) -> Path:
        return unit_folder(is_system=bool(self.user))

    @property
    def socket(self) -> str:
        """Path of busd's socket, in systemd's notation."""
        return f"{'/run' if self.user else '%t'}/busd/{self.domain}.sock"

    @property
    def paths(self) -> list[Path]:
        return [self.folder / f"{self.name}.{kind}" for kind in _KINDS]

    def texts(self, command: str, version: int | None) -> dict[Path, str]:
        """Contents of each file. `command` starts busd; `version` is systemd's version, None if unknown."""
        reloads_by_notify = version is not None and version >= _NOTIFY_RELOAD
        values = {
            "name": self.name,
            "domain": str(self.domain),
            "user": self.user,
            "group": self.group,
            "socket": self.socket,
            "command": command,
            # With notify-reload, systemd sends the signal itself and waits for the end of the reload.
            "type": "notify-reload" if reloads_by_notify else "notify",
            "reload": "" if reloads_by_notify else "/bin/kill -HUP $MAINPID",
        }
        scope = "system" if self.user else "user"
        return {path: _fill(f"{scope}.{kind}", values) for path, kind in zip(self.paths, _KINDS, strict=True)}

    def command(self) -> str:
        """The command that starts the busd of this installation, in the notation of ExecStart."""
        program = Path(sys.executable).with_name("busd")
        words = [str(program)] if program.is_file() else [sys.executable, "-m", "busd"]
        words += ["--domain", str(self.domain)] if self.domain else []
        words += ["--config", str(self.config)] if self.config is not None else []
        return " ".join(map(quoted, words))


def systemd_version(environ: Mapping[str, str] = os.environ) -> int | None:
    """Version of the installed systemd; None without systemd."""
    systemctl = shutil.which("systemctl", path=environ.get("PATH"))
    if systemctl is None:
        return None
    try:
        said = subprocess.run(
            [systemctl, "--version"], capture_output=True, text=True, timeout=10, check=True
        ).stdout
        return int(said.split()[1])
    except (OSError, subprocess.SubprocessError, ValueError, IndexError):
        return None


def _fill(name: str, values: Mapping[str, str]) -> str:
    text = Template((files("bus_cli.daemon") / "systemd" / name).read_text()).substitute(values)
    return "".join(line for line in text.splitlines(keepends=True) if line != "ExecReload=\n")
