"""`nav2_common`, as far as Nav2's launch files import it: `nav2_common.launch`."""
