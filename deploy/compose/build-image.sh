#!/usr/bin/env bash
# Packs the programs that `cargo build --release` made, and the libraries they load, into the image skein:local.
# Needs no registry: the image holds nothing else, not even a shell.
set -euo pipefail
cd "$(dirname "$0")/../.."

programs=(target/release/skein target/release/skein-sim)
for program in "${programs[@]}"; do
    if [ ! -x "$program" ]; then
        echo "$program is missing; first: cargo build --release --locked --bins" >&2
        exit 1
    fi
done

root=$(mktemp --directory)
trap 'rm -rf "$root"' EXIT
mkdir -p "$root/usr/bin" "$root/tmp" "$root/etc"
for program in "${programs[@]}"; do
    strip --strip-debug -o "$root/usr/bin/${program##*/}" "$program"
    # Every absolute path that the loader names, itself included, at the place where it looks for it.
    ldd "$program" | grep -o '/[^ ]*' | while read -r library; do
        install -D "$library" "$root$library"
    done
done
# The resolver: files first, then Docker's own name server.
echo "hosts: files dns" >"$root/etc/nsswitch.conf"

docker build --quiet --tag skein:local --file - "$root" <<'DOCKERFILE'
FROM scratch
COPY . /
ENV PATH=/usr/bin
CMD ["skein", "run", "--config", "/etc/skein/skein.toml"]
DOCKERFILE
echo "built skein:local"
