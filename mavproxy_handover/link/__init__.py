# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations' links: devices that move bytes, a monitor that measures a link, and a bundle that joins several links.

* `forms`: parses device strings in pymavlink's form.
* `base`, `udp`, `tcp`, `serial_line`: the devices. None blocks, and none raises after its construction.
* `devices`: makes the device for a device string.
* `quality`, `timesync`, `monitor`: measure one link and decide when it is degraded.
* `link_sequencer`: numbers the frames that leave by one link, so that gaps at the receiver show the loss of this link.
* `bundle`: the links of one station: removes duplicates, chooses the best link down, switches over.

This package does not know which senders are allowed. The caller says which frames are genuine (`LinkBundle.accept`).
Only senders of genuine frames get answers, and only genuine frames are counted.
"""
