#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Puts the robot's runtime on this host: see README.md beside this file. Running it again changes only what is new.
set -eu
# The units' user reads what is put here, whatever the caller keeps from others.
umask 022

usage() {
    cat <<'TEXT'
usage: deploy/install.sh [--robot NAME] [--python PYTHON] [--wheels DIR] [--no-warm-up] [--enable]

  --robot NAME     the robot that this host is in (default: the one installed before, or uslgo1)
  --python PYTHON  a Python from 3.10 to 3.13, not below /root or /home (default /usr/bin/python3)
  --wheels DIR     take every package from this directory, nothing from the network
  --no-warm-up     compile the loops at their first start, not now
  --enable         start the robot's processes now and with the host

DESTDIR=DIR in the environment puts the files below DIR and leaves this host alone: no environment, user or service.
TEXT
}

robot='' python=/usr/bin/python3 wheels='' warm_up=yes enable=no
while [ $# -gt 0 ]; do
    case $1 in
        --robot) robot=${2:?--robot needs a name}; shift ;;
        --python) python=${2:?--python needs a program}; shift ;;
        --wheels) wheels=$(cd "${2:?--wheels needs a directory}" && pwd); shift ;;
        --no-warm-up) warm_up=no ;;
        --enable) enable=yes ;;
        -h | --help) usage; exit 0 ;;
        *) usage >&2; exit 2 ;;
    esac
    shift
done

destdir=${DESTDIR:-}
deploy=$(cd "$(dirname "$0")" && pwd)
sources=$(dirname "$deploy")
opt=/opt/ugv
cache=/var/cache/ugv
shipped=$opt/shipped.sha256
units=/etc/systemd/system
[ -n "$robot" ] || robot=$(sed -n 's/^UGV_ROBOT=//p' "$destdir/etc/ugv/ugv.conf" 2> /dev/null || true)
robot=${robot:-uslgo1}

say() { printf '%s\n' "$*"; }
refuse() { printf 'install.sh: %s\n' "$*" >&2; exit 2; }
digest() { sha256sum "$1" | cut -d ' ' -f 1; }

# What was shipped to a path by the last installation.
shipped_before() { [ ! -f "$destdir$shipped" ] || sed -n "s|^\([0-9a-f]*\)  $1\$|\1|p" "$destdir$shipped"; }

# put MODE SOURCE PATH: a file that a person has edited is kept, and a newer version is put beside it.
put() {
    new=$(digest "$2") before=$(shipped_before "$3") target=$destdir$3
    printf '%s  %s\n' "$new" "$3" >> "$listing"
    if [ ! -e "$target" ]; then
        mkdir -p "$(dirname "$target")"
        install -m "$1" "$2" "$target"
        say "new      $3"
    elif [ "$(digest "$target")" = "$new" ]; then
        rm -f "$target.new"
    elif [ "$(digest "$target")" = "$before" ]; then
        install -m "$1" "$2" "$target"
        say "updated  $3"
    elif [ "$new" = "$before" ] || { [ -e "$target.new" ] && [ "$(digest "$target.new")" = "$new" ]; }; then
        say "kept     $3, as you edited it"
    else
        install -m "$1" "$2" "$target.new"
        say "kept     $3, as you edited it; the version that comes now is $3.new"
    fi
}

# What an earlier version shipped and this one does not.
remove_left_over() {
    [ -f "$destdir$shipped" ] || return 0
    while read -r before path; do
        if ! grep -q "  $path\$" "$listing" && [ -e "$destdir$path" ]; then
            if [ "$(digest "$destdir$path")" = "$before" ]; then
                rm "$destdir$path"
                say "removed  $path"
            else
                say "kept     $path, as you edited it, though nothing uses it any more"
            fi
        fi
    done < "$destdir$shipped"
}

put_files() {
    printf '# SPDX-License-Identifier: Apache-2.0\n# The robot that this host is in; its configuration is %s\nUGV_ROBOT=%s\n' \
        "/etc/ugv/$robot.toml" "$robot" > "$work/ugv.conf"
    put 644 "$work/ugv.conf" /etc/ugv/ugv.conf
    put 644 "$configuration" "/etc/ugv/$robot.toml"
    for file in "$deploy"/zenoh/*; do
        mode=644
        [ ! -x "$file" ] || mode=755
        [ "$(basename "$file")" != peer-users.json5 ] || mode=640
        [ ! -f "$file" ] || put $mode "$file" "/etc/ugv/zenoh/$(basename "$file")"
    done
    for file in ugv.target ugv-control.service ugv-link.service ugv-recorder.service ugv-.service.d/10-common.conf; do
        put 644 "$deploy/systemd/$file" "$units/$file"
    done
    put 644 "$deploy/network/60-ugv-can.link" /etc/systemd/network/60-ugv-can.link
    bit_rate=$(sed -n 's/^bit_rate_hz *= *\([0-9_]*\).*/\1/p' "$destdir/etc/ugv/$robot.toml" | tr -d _)
    sed "s/^BitRate=.*/BitRate=$bit_rate/" "$deploy/network/60-ugv-can.network" > "$work/60-ugv-can.network"
    put 644 "$work/60-ugv-can.network" /etc/systemd/network/60-ugv-can.network
    put 644 "$deploy/modules-load.d/ugv.conf" /etc/modules-load.d/ugv.conf
    if grep -qs tegra /proc/device-tree/compatible; then
        put 644 "$deploy/modules-load.d/ugv-jetson.conf" /etc/modules-load.d/ugv-jetson.conf
    fi
    put 644 "$deploy/sysusers.d/ugv.conf" /etc/sysusers.d/ugv.conf
    put 644 "$deploy/udev/70-ugv.rules" /etc/udev/rules.d/70-ugv.rules
    put 644 "$deploy/limits.d/90-ugv.conf" /etc/security/limits.d/90-ugv.conf
    put 644 "$deploy/README.md" $opt/README.md
    put 644 "$sources/constraints.txt" $opt/constraints.txt
    for file in "$deploy"/examples/*; do
        put 644 "$file" "$opt/examples/$(basename "$file")"
    done
    put 755 "$deploy/uninstall.sh" $opt/uninstall.sh
}

# Private keys and passwords, which a person puts there, are for root and the link alone.
protect_secrets() {
    zenoh=$destdir/etc/ugv/zenoh
    for secret in "$zenoh"/*.key "$zenoh"/users.txt "$zenoh"/peer-users.json5*; do
        [ -f "$secret" ] || continue
        chmod 640 "$secret"
        [ -n "$destdir" ] || chown root:ugv "$secret"
    done
}

# The group is new, so the rule about its device has to be looked at again.
apply_rules() {
    command -v udevadm > /dev/null && [ -S /run/udev/control ] || return 0
    udevadm control --reload
    udevadm trigger --name-match=cpu_dma_latency
}

put_environment() {
    state=$({ cd "$sources"; "$python" -VV; find runtime drivers sim_bridge pyproject.toml constraints.txt -type f \
        ! -name '*.pyc' -exec sha256sum {} + | LC_ALL=C sort -k 2; } | sha256sum | cut -d ' ' -f 1)
    if [ "$(cat $opt/venv/.installed 2>/dev/null || true)" = "$state" ]; then return 0; fi
    say "new      $opt/venv (takes a few minutes)"
    rm -rf $opt/venv
    "$python" -m venv $opt/venv
    offline=''
    [ -z "$wheels" ] || offline="--no-index --find-links=file://$wheels"
    # shellcheck disable=SC2086  # two options or none
    $opt/venv/bin/python -m pip install --quiet --disable-pip-version-check $offline -c "$sources/constraints.txt" "$sources"
    printf '%s\n' "$state" > $opt/venv/.installed
}

# Steps every loop of a robot for a while, without buses or sensors.
rehearsal='
import sys
from runtime.cli.main import single_threaded
single_threaded()
from runtime.robots import load_configuration, rehearse
rehearse(load_configuration(sys.argv[1]))'

# The units read the compiled loops from the cache, so it is their user that compiles. Each robot has loops of its own.
compile_loops() {
    state="$(cat $opt/venv/.installed) $robot"
    if [ "$(cat $cache/.compiled 2>/dev/null || true)" = "$state" ]; then return 0; fi
    say "new      $cache (the loops are compiled: a minute or two)"
    rm -rf $cache
    install -d -o ugv -g ugv -m 750 $cache
    (cd / && setpriv --reuid=ugv --regid=ugv --clear-groups env UGV_CACHE_DIR=$cache \
        $opt/venv/bin/python -c "$rehearsal" "$robot") || refuse "the loops could not be compiled; see above"
    printf '%s\n' "$state" > $cache/.compiled
}

# A process that begins, ends or waits to be started again uses the environment as one that is active does.
check_nothing_runs() {
    states=$(systemctl show --property=ActiveState --value ugv-control.service ugv-link.service ugv-recorder.service) ||
        refuse "systemd does not tell what runs"
    for state in $states; do
        case $state in
            inactive | failed) ;;
            *) refuse "the robot's processes are running; first: systemctl stop ugv.target" ;;
        esac
    done
}

check_host() {
    [ "$(id -u)" -eq 0 ] || refuse "needs root: run it with sudo"
    command -v systemctl > /dev/null || refuse "this host has no systemd"
    "$python" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' 2> /dev/null ||
        refuse "$python is not a Python from 3.10 to 3.13; name another one with --python"
    "$python" -c 'import ensurepip, venv' 2> /dev/null ||
        refuse "$python cannot create environments; on Debian and Ubuntu run: apt install python3-venv"
    case $("$python" -c 'import os, sys; print(os.path.realpath(sys.base_prefix))') in
        /root* | /home*) refuse "$python lies where the units cannot see it; name one of the system with --python" ;;
    esac
    check_nothing_runs
}

configuration=$(ls "$sources"/runtime/robots/*/"$robot.toml" 2> /dev/null) || refuse "there is no robot $robot"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
chmod 755 "$work"
listing=$work/shipped
: > "$listing"
[ -n "$destdir" ] || check_host

put_files
remove_left_over
LC_ALL=C sort -k 2 "$listing" > "$work/sorted"
cmp -s "$work/sorted" "$destdir$shipped" || install -m 644 "$work/sorted" "$destdir$shipped"
if [ -n "$destdir" ]; then
    protect_secrets
    say "files only: no environment, user or service below $destdir"
    exit 0
fi

systemd-sysusers ugv.conf
protect_secrets
apply_rules
put_environment
[ $warm_up = no ] || compile_loops
systemctl daemon-reload
[ $enable = no ] || systemctl enable --now ugv.target

say
say "Left to you:"
say "  - this robot's values:       /etc/ugv/$robot.toml, then $opt/venv/bin/ugv config check /etc/ugv/$robot.toml"
say "  - the CAN channels:          systemctl enable --now systemd-networkd   (or a reboot; see $opt/README.md)"
say "  - is this host fit to run:   $opt/venv/bin/ugv doctor $robot --config /etc/ugv/$robot.toml"
[ $enable = yes ] || say "  - start, now and at boot:    systemctl enable --now ugv.target"
