#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Removes what install.sh put on this host. Logs, edited files, keys and passwords stay, unless --purge is given.
set -eu

purge=no
case ${1:-} in
    '') ;;
    --purge) purge=yes ;;
    *) echo "usage: uninstall.sh [--purge]     --purge: with logs, edited files, secrets and the user ugv" >&2; exit 2 ;;
esac

destdir=${DESTDIR:-}
opt=/opt/ugv
shipped=$destdir$opt/shipped.sha256

say() { printf '%s\n' "$*"; }
refuse() { printf 'uninstall.sh: %s\n' "$*" >&2; exit 2; }

remove_files() {
    while read -r before path; do
        file=$destdir$path
        rm -f "$file.new"
        if [ ! -e "$file" ]; then
            continue
        elif [ $purge = yes ] || [ "$(sha256sum "$file" | cut -d ' ' -f 1)" = "$before" ]; then
            rm "$file"
            say "removed  $path"
        else
            say "kept     $path, as you edited it"
        fi
    done < "$shipped"
}

# Keys, certificates and passwords, which a person put there.
remove_secrets() {
    for file in "$destdir"/etc/ugv/zenoh/*.key "$destdir"/etc/ugv/zenoh/*.pem "$destdir"/etc/ugv/zenoh/users.txt; do
        [ -f "$file" ] || continue
        if [ $purge = yes ]; then
            rm "$file"
            say "removed  ${file#"$destdir"}"
        else
            say "kept     ${file#"$destdir"}"
        fi
    done
}

# Of the directories, those that installing made; one in which something was left stays.
remove_directories() {
    for directory in /etc/ugv/zenoh /etc/ugv /etc/systemd/system/ugv-.service.d $opt/examples $opt; do
        [ ! -d "$destdir$directory" ] || rmdir --ignore-fail-on-non-empty "$destdir$directory"
    done
}

[ -f "$shipped" ] || refuse "nothing is installed: $shipped is missing"
if [ -z "$destdir" ]; then
    [ "$(id -u)" -eq 0 ] || refuse "needs root: run it with sudo"
    systemctl disable --now ugv.target
    systemctl stop ugv-control.service ugv-link.service ugv-recorder.service
fi
remove_files
remove_secrets
rm -f "$shipped"
rm -rf "$destdir/opt/ugv/venv" "$destdir/var/cache/ugv" "$destdir/run/ugv"
remove_directories
if [ -z "$destdir" ]; then
    systemctl daemon-reload
    if [ $purge = yes ]; then
        rm -rf /var/log/ugv
        userdel ugv 2> /dev/null || true
        say "removed  /var/log/ugv and the user ugv"
    else
        say "kept     /var/log/ugv and the user ugv"
    fi
fi
