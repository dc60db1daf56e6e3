"""Recorded logs into the canonical form. Each importer returns checked logs; writing them is the caller's business."""

from aspnn.logs.ais import import_ais
from aspnn.logs.csv_map import import_csv
from aspnn.logs.esso_osaka import import_esso_osaka
from aspnn.logs.n2k_yacht import import_n2k_yacht
from aspnn.logs.nmea import import_nmea0183

__all__ = ["import_ais", "import_csv", "import_esso_osaka", "import_n2k_yacht", "import_nmea0183"]
