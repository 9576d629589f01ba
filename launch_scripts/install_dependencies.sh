#!/usr/bin/env bash
# Installs the Debian packages of apt_packages.txt that are missing. Quick when there is nothing to do.
# usage: install_dependencies.sh [--with NAME]   also those that are listed as "NAME: package"
set -euo pipefail
with=""
if [ "${1-}" = --with ] && [ $# -eq 2 ]; then with=$2; elif [ $# -gt 0 ]; then
  echo "install_dependencies.sh: expected nothing or --with NAME" >&2
  exit 2
fi
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
mapfile -t wanted < <(sed -e 's/#.*//' -e 's/[[:space:]]//g' ${with:+-e "s/^$with://"} -e '/:/d' -e '/^$/d' "$here/apt_packages.txt")

missing=()
for package in "${wanted[@]}"; do
  status=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$status" = installed ] || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "portolan: to install ${missing[*]}, run this as root or install sudo" >&2; exit 1; }
  as_root=(sudo)
fi
echo "portolan: installing ${#missing[@]} packages: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
