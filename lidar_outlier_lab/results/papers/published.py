# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""What the papers print, number for number, slips included."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from lidar_outlier_filter.evaluation.confusion import Confusion

# Leslar, Wang and Hu (2010) ---------------------------------------------------------------------

POINTS = (1_098_689, 295_147, 237_740)  # of A, B and C, table 1
OUTLIERS = (11_035, 872, 31)


class Row(NamedTuple):
    """A column of tables 2 to 5: outliers found, good points rejected, outliers missed."""

    found: int
    wrong: int
    missed: int


LESLAR: Mapping[str, tuple[Row, Row, Row]] = MappingProxyType(
    {
        'a': (Row(3414, 55, 7621), Row(291, 27, 581), Row(4, 3, 27)),
        'b': (Row(16, 0, 11_024), Row(33, 0, 839), Row(4, 0, 27)),
        'c': (Row(5221, 15_431, 5060), Row(712, 0, 160), Row(15, 193, 16)),
        # Both routines of table 5 together: 3449 + 11 and 53 + 1, and so on.
        'ab': (Row(3460, 54, 7575), Row(314, 25, 558), Row(5, 4, 27)),
    }
)

# Sotoodeh (2006), table 3: LOF, MinPts = 20, rejected above 1.2, on an airborne cloud.
LOF = Confusion(found=319, missed=4273, lost=1261, kept=109_967)
LOF_PRINTED = ('1.09 %', '3.68 %')  # its α- and β-error; 4273 of 115 820 are 3.69 %
# Table 1, the images of the surface, row by row.
LOF_IMAGES = MappingProxyType(
    {
        'scale of the images': '1:5300',
        'focal length': '153.59 mm',
        'frame': '230.0 mm',
        'pixel': '0.014 mm',
        'points of the surface': '~100 per m²',
    }
)
# Table 2, manual measurements and the laser against the surface: mean, standard deviation and
# maximum; limit of 5.1.1.
LOF_CHECKS = (0.126, 0.365, 1.774)  # metres
LOF_RESIDUALS = (0.201, 1.533, 7.474)  # metres
LOF_LIMIT = 3.066  # metres

# Sotoodeh (2007), table 1: phases 1 and 2.
HIERARCHICAL = (
    Confusion(found=75, missed=9, lost=3, kept=569),
    Confusion(found=4, missed=3, lost=6, kept=565),
)

HIERARCHICAL_PRINTED = (('0.45 %', '1.37 %'), ('1.04 %', '0.52 %'))  # α- and β-error

# Kang, Huang and Yang (2018), table 1, with k = 30 and 60: share eliminated, seconds.
KANG: Mapping[str, tuple[tuple[float, float], tuple[int, int]]] = MappingProxyType(
    {
        'kang-urban': ((0.00047, 0.00051), (88, 191)),
        'kang-mountain': ((0.00022, 0.00024), (176, 340)),
    }
)

# Pirotti, Ravanelli, Fissore and Masiero (2018), abstract and results ----------------------------

PIROTTI_CLUSTERED = MappingProxyType({'LOF2': 0.597, 'SOR2': 0.530})  # found with k = 60
PIROTTI_LIMITS = MappingProxyType({'SOR2': 0.25, 'LOF': 1.1})  # metres with k = 60; with k = 10
