#!/usr/bin/env bash
# Prints the Python of an environment with the packages of a requirements file:
#
#   python_env.sh [FILE]    by default benchmark/requirements.txt
#
# The first time it creates the environment, in the user's cache folder, named
# after the packages and the interpreter. Fails where they cannot be obtained.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

requirements=${1:-benchmark/requirements.txt}
cache=${XDG_CACHE_HOME:-$HOME/.cache}/dgsfm
key=$({
  /usr/bin/python3 --version
  cat "$requirements"
} | sha256sum | cut -c1-16)
environment=$cache/python-$key

# Environments appear whole: their scripts name the final folder, but only
# bin/python is used, which does not.
if [[ ! -d $environment ]]; then
  mkdir -p "$cache"
  exec 9>"$cache/python.lock"
  flock 9
  if [[ ! -d $environment ]]; then
    echo "Installing Python packages: a minute, once" >&2
    rm -rf "$environment.new"
    /usr/bin/python3 -m venv "$environment.new" >&2
    "$environment.new/bin/python" -m pip install --quiet \
      --disable-pip-version-check --only-binary :all: \
      --requirement "$requirements" >&2
    mv "$environment.new" "$environment"
  fi
fi
echo "$environment/bin/python"
