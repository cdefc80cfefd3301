"""One record of a run: what each node's steps consumed, the MCAP file, and how both are read again.

:mod:`.journal` and :mod:`.snapshot` run inside each process, :mod:`.mcap_file` writes, :mod:`.reader` reads.
"""
