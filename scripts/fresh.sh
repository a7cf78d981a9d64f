# SPDX-License-Identifier: MIT
# Functions for check_fresh and package. They install a bare Debian of the release $release (bookworm or trixie) in $root
# with debootstrap, from the Debian mirror in this machine's apt configuration. debootstrap checks the signature of the
# release with the keys in the package debian-archive-keyring. They need root rights and 4 GB of disk space.
# $root, and the roots before it, are removed when the script ends.

own=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")  # the release of this machine
release=$own

# fresh_mirror: sets $mirror; prints a message and fails if there is no mirror or the user is not root.
fresh_mirror() {
  if [ "$(id -u)" != 0 ]; then
    echo "$(basename "$0"): requires root privileges for debootstrap and chroot" >&2
    return 1
  fi
  command -v debootstrap >/dev/null || apt-get install -q -y debootstrap >&2 || return 1
  mirror=$(apt-get indextargets --format '$(REPO_URI) $(CODENAME) $(ORIGIN)' 'Created-By: Packages' |
    awk -v own="$own" '$2 == own && $3 == "Debian" {print $1; exit}')
  [ -n "$mirror" ] && return
  echo "$(basename "$0"): apt on this machine has no Debian mirror" >&2
  return 1
}

fresh_cleanup() {
  for root in $roots; do
    for place in proc dev/pts dev ccache; do umount "$root/$place" 2>/dev/null || true; done
    rm -f "$root.log"
    mountpoint -q "$root/dev" || mountpoint -q "$root/ccache" || rm -rf --one-file-system "$root"
  done
}

# fresh_root PACKAGE...: installs Debian in $root from $mirror, with these packages.
fresh_root() {
  root=$(mktemp -d "${TMPDIR:-/tmp}/echofuse-fresh.XXXXXX")
  roots="${roots:-} $root"
  trap fresh_cleanup EXIT
  trap 'exit 130' INT TERM
  debootstrap --variant=minbase "$release" "$root" "$mirror" >"$root.log" 2>&1 ||
    { tail "$root.log" >&2; rm "$root.log"; exit 1; }
  rm -f "$root.log"
  chmod 755 "$root"  # mktemp -d gives access to root only
  mount -t proc proc "$root/proc"
  mount --bind /dev "$root/dev"
  mount --bind /dev/pts "$root/dev/pts"
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  # Copies apt's local settings, but no files of packages, because dpkg would ask which version to keep.
  for settings in /etc/apt/apt.conf.d/*; do
    dpkg -S "$settings" >/dev/null 2>&1 || cp "$settings" "$root/etc/apt/apt.conf.d/"
  done
  in_root "apt-get update -q && apt-get install -q -y --no-install-recommends ca-certificates $*" >/dev/null
}

# fresh_ccache: if CCACHE_DIR is set, commands in $root use ccache with that folder. Needs the package ccache in $root.
fresh_ccache() {
  [ -n "${CCACHE_DIR:-}" ] || return 0
  mkdir -p "$CCACHE_DIR" "$root/ccache"
  mount --bind "$CCACHE_DIR" "$root/ccache"
  cached="CCACHE_DIR=/ccache CCACHE_SLOPPINESS=pch_defines,time_macros CMAKE_CXX_COMPILER_LAUNCHER=ccache"
}

# in_root COMMAND: runs a shell command in $root.
in_root() {
  chroot "$root" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
    ${cached:-} sh -c "$1"
}

# timed COMMAND...: runs the command and prints its duration.
timed() {
  echo "== $*" >&2
  began=$(date +%s)
  "$@"
  echo "== $*: ok after $(($(date +%s) - began)) s" >&2
}
