#!/usr/bin/env bash
# A text attribute in UTF-8 that the netCDF C library writes as NC_CHAR (bytes given to setncattr) is read by that library, by
# ncdump and by the netcdf4 engine of xarray as the text. h5netcdf 1.8.2 gives lone surrogates instead, because the C library marks
# the HDF5 string as ASCII: printing it raises UnicodeEncodeError. As NC_STRING (a str given to setncattr) both read it, but
# programs of classic files (Octave's ncinfo) refuse such a file.
set -euo pipefail
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet netCDF4==1.7.5.1.post1 h5netcdf==1.8.2 h5py==3.16.0 numpy==2.4.6
cd "$place"
"$place/venv/bin/python" - <<'PY'
import h5netcdf
import netCDF4

with netCDF4.Dataset("a.nc", "w") as file:
    file.setncattr("chars", "Γ".encode())
    file.setncattr("string", "Γ")
with netCDF4.Dataset("a.nc") as file:
    by_c = file.getncattr("chars"), file.getncattr("string")
with h5netcdf.File("a.nc") as file:
    by_h5 = str(file.attrs["chars"]), str(file.attrs["string"])
print("netCDF4", netCDF4.__version__, ascii(by_c))
print("h5netcdf", h5netcdf.__version__, ascii(by_h5))
assert by_c == ("Γ", "Γ")
assert by_h5 == ("\udcce\udc93", "Γ")
try:
    by_h5[0].encode()
except UnicodeEncodeError as error:
    print("UnicodeEncodeError:", error)
else:
    raise SystemExit("it can be encoded now")
assert by_h5[0].encode("utf-8", "surrogateescape").decode() == "Γ"
PY
