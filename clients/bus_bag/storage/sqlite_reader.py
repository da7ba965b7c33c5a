"""Reads one SQLite file of a bag (.db3), the default format of ROS 2 before Iron.

A file may contain any bytes. Reading it ends, and raises only BagError. Unreadable parts become a Problem.
"""

import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bus.base.counted import counted
from bus_bag.errors import BagError
from bus_bag.metadata import BagMetadata, TopicMetadata, from_record
from bus_bag.profiles import profiles_from_yaml
from bus_bag.storage.bag_file import BagMessage, Order, Problem, Summary
from bus_bag.storage.decompression import MAX_SIZE
from bus_bag.storage.stretches import Stretch

__all__ = ["SqliteFile"]

_FAULTS = (sqlite3.Error, UnicodeError, OverflowError, MemoryError)
"""Errors that reading a damaged file may raise; UnicodeError if the text of the error is damaged, too."""
_MAGIC = b"SQLite format 3\0"


class SqliteFile:
    """See `BagFile`. Problems name `path`; the bytes may be in another file, `content`.

    Raises BagError if it is not such a file of a bag, OSError if it can't be opened.
    """

    storage = "sqlite3"
    has_index = True
    is_being_written = False  # SQLite files do not show it

    def __init__(self, path: Path, content: Path | None = None) -> None:
        self.path = path
        self.summary = Summary()
        self.topics: dict[str, TopicMetadata] = {}
        self.extra: dict[str, dict[str, str]] = {}
        self.definitions: dict[str, str] = {}
        self.records: list[tuple[str, dict[str, str]]] = []
        self.problems: list[Problem] = []
        self.is_cut = False
        self._names: dict[int, str] = {}
        self._check_size(content or path)
        try:
            self._database = _open(content or path)
            self._tables = self._find_tables()
            self._read_topics()
            self._read_definitions()
            self._count()
        except _FAULTS as error:
            self.close()
            raise BagError(f"'{path}' can't be read: {error}") from None
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        if hasattr(self, "_database"):
            self._database.close()

    def metadata(self) -> BagMetadata | None:
        """The file's description of the whole bag."""
        if "metadata" not in self._tables:
            return None
        try:
            row = self._database.execute("SELECT metadata FROM metadata ORDER BY id DESC LIMIT 1").fetchone()
            return from_record(str(row[0])) if row else None
        except (*_FAULTS, ValueError) as error:
            self._problem(f"its metadata can't be read: {error}")
            return None

    def messages(self, start: int | None, topics: frozenset[str] | None, by: Order) -> Iterator[BagMessage]:
        """Messages in order; `start`: from that time on; `topics`: only of these. Log and publish time are
        the same."""
        wanted = {number: name for number, name in self._names.items() if topics is None or name in topics}
        conditions, values = [], list[int]()
        if start is not None:
            conditions.append("timestamp >= ?")
            values.append(min(start, 2**63 - 1))
        if topics is not None:
            conditions.append(_is_one_of(wanted))
            values += wanted
        where = f" WHERE {' AND '.join(conditions)}" if conditions else ""
        query = f"SELECT topic_id, timestamp, data FROM messages{where} ORDER BY timestamp, id"
        passed_over = 0
        try:
            for topic, time, data in self._database.execute(query, values):
                if topic in wanted and isinstance(time, int) and time >= 0 and isinstance(data, bytes):
                    yield BagMessage(wanted[topic], time, time, 0, data)
                else:
                    passed_over += 1
        except _FAULTS as error:
            self._problem(f"the rest of its messages can't be read: {error}")
        if passed_over:
            rows = counted(passed_over, "row", "is", "are")
            self._problem(f"{rows} skipped: no message of a topic")

    def stretches(self, least: int, topics: frozenset[str], by: Order) -> Iterator[Stretch]:
        """See `BagFile`. SQLite compares the times: it is several times faster than Python here."""
        wanted = [number for number, name in self._names.items() if name in topics]
        query = (
            "SELECT before, timestamp FROM ("
            "SELECT timestamp, LAG(timestamp) OVER (ORDER BY timestamp) AS before FROM messages "
            f"WHERE {_is_one_of(wanted)} AND typeof(timestamp) = 'integer' AND timestamp >= 0"
            ") WHERE before IS NULL OR timestamp - before > ?"
        )
        start = None
        try:
            for before, time in self._database.execute(query, (*wanted, least)):
                if start is not None:
                    yield Stretch(start, before)
                start = time
        except _FAULTS as error:
            self._problem(f"gaps between its messages can't be found: {error}")
        if start is not None:
            yield Stretch(start, max(start, self.summary.end_time))

    def _problem(self, text: str) -> None:
        problem = Problem(str(self.path), None, text)
        if problem not in self.problems:
            self.problems.append(problem)

    def _check_size(self, path: Path) -> None:
        with path.open("rb") as file:
            head = file.read(100)
        if not head:
            raise BagError(f"'{self.path}' is empty")
        if len(head) < 100 or not head.startswith(_MAGIC):
            raise BagError(f"'{self.path}' is not an SQLite file: its first bytes are different")
        page = int.from_bytes(head[16:18], "big")
        pages = int.from_bytes(head[28:32], "big")
        size, whole = path.stat().st_size, (65536 if page == 1 else page) * pages
        if head[24:28] == head[92:96] and size < whole:
            self.is_cut = True
            self._problem(f"the file is cut off: {size:,} bytes of {whole:,}")

    def _find_tables(self) -> dict[str, set[str]]:
        """Tables -> their columns. Views are left out, because a view may be anything."""
        found = {}
        for (name,) in self._database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'"
        ).fetchall():
            if name in ("topics", "messages", "message_definitions", "metadata"):
                rows = self._database.execute(f"PRAGMA table_info({name})").fetchall()
                found[name] = {row[1] for row in rows}
        if not {"topics", "messages"} <= found.keys():
            raise BagError(f"'{self.path}' is not a bag: the tables 'topics' and 'messages' are not in it")
        return found

    def _rows(self, table: str, *columns: str) -> list[tuple[Any, ...]]:
        """Rows of some columns. Columns that the file's version does not have are empty texts."""
        chosen = [column if column in self._tables[table] else f"'' AS {column}" for column in columns]
        return self._database.execute(f"SELECT {', '.join(chosen)} FROM {table} ORDER BY id").fetchall()

    def _read_topics(self) -> None:
        columns = (
            "id",
            "name",
            "type",
            "serialization_format",
            "offered_qos_profiles",
            "type_description_hash",
        )
        for number, *texts in self._rows("topics", *columns):
            name, type_name, encoding, profiles, type_hash = map(str, texts)
            try:
                offered = profiles_from_yaml(profiles)
            except ValueError as error:
                offered = ()
                self._problem(f"topic '{name}': {error}")
            topic = TopicMetadata(name, type_name, encoding, offered, type_hash)
            if self.topics.setdefault(name, topic).type == type_name:
                self._names[number] = name
            else:
                known = self.topics[name].type
                self._problem(f"topic '{name}' has types {known} and {type_name}; only the first is read")

    def _read_definitions(self) -> None:
        if "message_definitions" not in self._tables:
            return
        for name, encoding, text in self._rows(
            "message_definitions", "topic_type", "encoding", "encoded_message_definition"
        ):
            if encoding == "ros2msg" and text:
                self.definitions.setdefault(str(name), str(text))

    def _count(self) -> None:
        try:
            first, last = self._database.execute(
                "SELECT MIN(timestamp), MAX(timestamp) FROM messages"
            ).fetchone()
            rows = self._database.execute(
                "SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"
            ).fetchall()
        except _FAULTS as error:
            self._problem(f"its messages can't be counted: {error}")
            return
        counts: dict[str, int] = {}
        for number, count in rows:
            if number in self._names:
                name = self._names[number]
                counts[name] = counts.get(name, 0) + count
        is_timed = isinstance(first, int) and isinstance(last, int)
        self.summary = Summary(
            sum(counts.values()), max(first, 0) if is_timed else 0, max(last, 0) if is_timed else 0, counts
        )


def _is_one_of(topics: Collection[int]) -> str:
    """A condition with a place for the number of each topic."""
    return f"topic_id IN ({', '.join('?' * len(topics))})"


def _open(path: Path) -> sqlite3.Connection:
    """Open a file for reading only. In a folder without write permission, changes in a separate file beside
    it are ignored."""
    place = f"file:{quote(str(path.absolute()))}"
    for options in ("mode=ro", "immutable=1"):
        database = sqlite3.connect(f"{place}?{options}", uri=True, check_same_thread=False)
        try:
            database.text_factory = lambda text: text.decode(errors="replace")
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_SIZE)
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA temp_store = FILE")
            database.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()
            return database
        except sqlite3.OperationalError:
            database.close()
            if options == "immutable=1":
                raise
        except BaseException:
            database.close()
            raise
    raise AssertionError
