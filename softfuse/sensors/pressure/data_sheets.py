"""What pressure sensors put out, by part, as their data sheets say.

    output = R (slope P + offset)

* NXP MPX and MPXV, 5 V ratiometric (Freescale and NXP data sheets MPX4115A, MPX4250A, MPX5010 to MPX5700,
MPXV5004G, MPXV7002, MPXV7007): slope per kPa and offset as in their transfer functions, errors of 1.5 %
(MPX4), 2.5 %, 5 % (MPX5010, MPXV7007) of full scale, of 6.25 % for the two most sensitive without a zero that
is taken.
* Honeywell ABP and SSC (data sheets 32305128 and 50099533), transfer function A: 10 to 90 % of the supply, or
of 2^14 codes, over the `range` of the part, which has to be given; within 1.5 % and 2 % of full scale.
Analogue ones clip at 2.5 and 97.5 % of the supply.
* Barometers: Bosch BMP280 (BST-BMP280-DS001), BMP388 (BST-BMP388-DS001) and TE MS5611 (MS5611-01BA03) put out
Pa once the driver has compensated them, ST LPS22HB (DocID027083) 4096 codes per hPa; within 1 to 2.5 hPa.
Noise is that of the highest resolution without a filter.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any


def _nxp(
    slope: float,
    offset: float,
    low: float,
    high: float,
    *,
    error: float = 0.025,
    absolute: bool = False,
    supply: tuple[float, float] = (4.75, 5.25),
):
    return {
        "output": "volts",
        "slope": f"{slope} kPa^-1",
        "offset": offset,
        "range": [f"{low} kPa", f"{high} kPa"],
        "absolute": absolute,
        "ratiometric": True,
        "reference": "5 V",
        "reference_range": [f"{each} V" for each in supply],
        "low": "2 mV",
        "high": "4.998 V",
        "noise": "2 mV",
        "error": error,
        "bits": 12,
        "full_scale": "5 V",
    }


def _honeywell(error: float, *, digital: bool):
    volts = {
        "output": "volts",
        "reference": "5 V",
        "reference_range": ["4.75 V", "5.25 V"],
        "low": "0.125 V",
        "high": "4.875 V",
        "noise": "2 mV",
        "bits": 12,
        "full_scale": "5 V",
    }
    codes = {
        "output": "counts",
        "reference": 16384.0,
        "low": 0.0,
        "high": 16383.0,
        "noise": 3.0,
        "bits": 14,
        "full_scale": 16384.0,
    }
    own = codes if digital else volts
    return {**own, "share": [0.1, 0.9], "ratiometric": not digital, "error": error}


def _barometer(low: float, high: float, error: float, noise: float, codes_per_Pa: float):
    return {
        "output": "counts",
        "slope": f"{codes_per_Pa} Pa^-1",
        "offset": 0.0,
        "range": [f"{low} kPa", f"{high} kPa"],
        "absolute": True,
        "reference": 1.0,
        "low": 0.0,
        "high": 2e7,
        "noise": noise * codes_per_Pa,
        "error": error,
        "bits": 24,
        "full_scale": float(2**24),
    }


PRESSURE_PARTS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "MPX4115A": _nxp(0.009, -0.095, 15, 115, error=0.015, absolute=True, supply=(4.85, 5.35)),
        "MPX4250A": _nxp(0.004, -0.04, 20, 250, error=0.015, absolute=True, supply=(4.85, 5.35)),
        "MPX5010": _nxp(0.09, 0.04, 0, 10, error=0.05),
        "MPX5050": _nxp(0.018, 0.04, 0, 50),
        "MPX5100A": _nxp(0.009, -0.095, 15, 115, absolute=True),
        "MPX5100D": _nxp(0.009, 0.04, 0, 100),
        "MPX5100G": _nxp(0.009, 0.04, 0, 100),
        "MPX5500": _nxp(0.0018, 0.04, 0, 500),
        "MPX5700": _nxp(0.0012858, 0.04, 0, 700),
        "MPXV5004G": _nxp(0.2, 0.2, 0, 3.92, error=0.0625),
        "MPXV5010G": _nxp(0.09, 0.04, 0, 10, error=0.05),
        "MPXV5050G": _nxp(0.018, 0.04, 0, 50),
        "MPXV5100G": _nxp(0.009, 0.04, 0, 100),
        "MPXV7002": _nxp(0.2, 0.5, -2, 2, error=0.0625),
        "MPXV7007": _nxp(0.057, 0.5, -7, 7, error=0.05),
        "ABP-analog": _honeywell(0.015, digital=False),
        "ABP-digital": _honeywell(0.015, digital=True),
        "SSC-analog": _honeywell(0.02, digital=False),
        "SSC-digital": _honeywell(0.02, digital=True),
        "BMP280": _barometer(30, 110, 2.1e-3, 1.3, 1.0),
        "BMP388": _barometer(30, 125, 1.6e-3, 1.2, 1.0),
        "MS5611": _barometer(1, 120, 2.1e-3, 1.2, 1.0),
        "LPS22HB": _barometer(26, 126, 1e-3, 0.75, 40.96),
    }
)
"""Keys of `PressureSettings` that each part stands for."""
