#!/bin/sh
# make.sh RELEASE MODULES IMAGE, as root: a small Debian with systemd in a disk image for user-mode Linux, whose kernel modules are in
# the directory MODULES. The first thing that it does after booting is `start.sh`.
set -eu
release=$1 modules=$2 image=$3
here=$(cd "$(dirname "$0")" && pwd)
root=$(mktemp -d "$(dirname "$image")/root.XXXXXX")
trap 'rm -rf "$root" "$image.new"' EXIT

# Package lists fetched again are no gain in what is thrown away, nor is a disk that outlives a power failure.
mmdebstrap --quiet --variant=minbase --format=directory \
    --include=systemd,systemd-sysv,udev,dbus,libnss-systemd,kmod,iproute2,can-utils \
    --aptopt='Acquire::Languages "none"' --dpkgopt=force-unsafe-io \
    --dpkgopt='path-exclude=/usr/share/locale/*' --dpkgopt='path-exclude=/usr/share/man/*' \
    "$release" "$root"
rm -f "$root/etc/dpkg/dpkg.cfg.d/99mmdebstrap"
rm -rf "$root/usr/share/doc" "$root/usr/share/man"

mkdir -p "$root/usr/lib/modules" "$root/host"
cp -r "$modules" "$root/usr/lib/modules/"
install -m 755 "$here/start.sh" "$root/usr/local/sbin/wrenchd-tests"
install -m 644 "$here/wrenchd-tests.service" "$root/etc/systemd/system/"
echo wrenchd > "$root/etc/hostname"
# Known, or systemd would take each boot for the first and ask questions.
echo 0123456789abcdef0123456789abcdef > "$root/etc/machine-id"
units() { SYSTEMD_OFFLINE=1 chroot "$root" systemctl --quiet "$@"; }
units enable systemd-networkd.service wrenchd-tests.service
units disable systemd-networkd-wait-online.service
units mask getty.target apt-daily.timer apt-daily-upgrade.timer e2scrub_all.timer e2scrub_reap.service fstrim.timer
# Each reload of systemd would run them all, for a machine that has nothing for them to find.
mkdir -p "$root/etc/systemd/system-generators"
for generator in "$root"/lib/systemd/system-generators/*; do
    ln -s /dev/null "$root/etc/systemd/system-generators/${generator##*/}"
done

truncate -s 2G "$image.new"
mke2fs -q -t ext4 -d "$root" "$image.new"
chmod 644 "$image.new"
mv "$image.new" "$image"
