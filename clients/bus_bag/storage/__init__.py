"""Bags on disk: folders of MCAP files that are written, and of MCAP or SQLite files that are read."""

from bus_bag.storage.bag_file import BagMessage, Order, Problem
from bus_bag.storage.reader import BagReader, open_bag
from bus_bag.storage.writer import BagWriter

__all__ = ["BagMessage", "BagReader", "BagWriter", "Order", "Problem", "open_bag"]
