#!/usr/bin/env bash
# Makes .venv: the pinned requirements, real ROS 2 Jazzy among them, and the workspace built into it.
#
#   scripts/setup.sh [--no-kernels] [--web]
#
# Each step leaves a key of what it was made from in .venv/.tombo and is skipped while the key
# holds, so a run with nothing to do ends in a fraction of a second. A step takes its key away
# before it starts: one that was interrupted finds none and begins from scratch.
#
# PYTHON=python3.12 chooses the interpreter. Exit 2: something is missing on this system.

set -euo pipefail

readonly ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
readonly VENV="$ROOT/.venv" KEYS="$ROOT/.venv/.tombo" BUILD="$ROOT/build" SRC="$ROOT/tombo_ws/src"
readonly WHEELS="$ROOT/scripts/wheels" # packages of ROS of which there is no wheel
readonly OLDEST=11 NEWEST=13 CMAKE_NEEDED=3.21

kernels=yes web=no
for option in "$@"; do
  case "$option" in
    --no-kernels) kernels=no ;;
    --web) web=yes ;; # requirements-web.txt too
    *) echo "set-up: $option; accepted: --no-kernels, --web" >&2; exit 2 ;;
  esac
done

# A sourced ROS or another environment must not leak into this one.
unset PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX
unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH
unset ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION _ROS_WHEELS_BOOTSTRAP_COMPLETE

missing() { echo "set-up: $1" >&2; exit 2; }

# --- What each step is made from ------------------------------------------------------------

key() { sha256sum | cut -c1-16; }
requirements_key() { cat "$ROOT"/requirements{,-pip,-build,-study,-test}.txt | key; }
web_key() { cat "$ROOT"/requirements-web.txt | key; }
workspace_key() {
  {
    requirements_key
    cat "$ROOT/scripts/setup.sh" "$SRC"/*/{package.xml,setup.py,setup.cfg,CMakeLists.txt} \
      "$SRC"/*/cmake/* "$SRC"/*/{msg,srv,action}/* \
      "$WHEELS"/*/{package.xml,CMakeLists.txt} "$WHEELS"/*/msg/* 2>/dev/null
    cd "$SRC" && ls -d -- */{config,launch,resource}/* 2>/dev/null
  } | key || true
}
kernels_key() {
  {
    requirements_key
    find "$SRC"/tombo_{dynamics,control,collision,sim} -name '*.py' ! -name '*_node.py' -print0 2>/dev/null | sort -z | xargs -0 cat
  } | key || true
}
holds() { [ "$(cat "$KEYS/$1" 2>/dev/null)" = "$2" ]; }

python_version() {
  "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}
supported() {
  case "$1" in 3.*) [ "${1#3.}" -ge $OLDEST ] && [ "${1#3.}" -le $NEWEST ] ;; *) false ;; esac
}

look() { # what has to be done?
  make_venv=no install=no build=no warm=no browser=no
  requirements="$(requirements_key)" workspace="$(workspace_key)" compiled="$(kernels_key)"
  holds root "$ROOT" && [ -s "$KEYS/requirements" ] && [ -x "$VENV/bin/python" ] || make_venv=yes
  if [ -n "${PYTHON:-}" ] && ! holds python "$(python_version "$PYTHON")"; then make_venv=yes; fi
  if [ $make_venv = yes ] || ! holds requirements "$requirements"; then install=yes; fi
  if [ $install = yes ] || ! holds workspace "$workspace"; then build=yes; fi
  if [ -f "$SRC/tombo_bringup/tombo_bringup/warmup.py" ] && [ $kernels = yes ]; then
    if [ $build = yes ] || ! holds kernels "$compiled"; then warm=yes; fi
  fi
  if [ $web = yes ] && { [ $install = yes ] || ! holds web "$(web_key)"; }; then browser=yes; fi
  [ $make_venv$install$build$warm$browser != nonononono ]
}

# --- What the system must have --------------------------------------------------------------

choose_python() {
  local candidate version
  if [ -n "${PYTHON:-}" ]; then
    version="$(python_version "$PYTHON")" || version="not a Python"
    supported "$version" ||
      missing "PYTHON=$PYTHON is $version; accepted is Python 3.$OLDEST to 3.$NEWEST (Debian package python3)"
    python="$PYTHON"
    return
  fi
  for candidate in python3 python3.13 python3.12 python3.11; do
    version="$(python_version "$candidate")" || continue
    if supported "$version"; then
      python="$candidate"
      return
    fi
  done
  missing "no Python 3.$OLDEST to 3.$NEWEST found; install the Debian package python3, or name one with PYTHON="
}

check_system() {
  [ "$(uname -sm)" = "Linux x86_64" ] ||
    missing "this is $(uname -sm); the ROS 2 wheels are for Linux x86_64 only"
  if [ $make_venv = yes ]; then choose_python; else python="$VENV/bin/python"; fi
  version="$(python_version "$python")" package="python$version"
  [ "$(basename "$python")" = python3 ] && package=python3
  "$python" -c 'import ensurepip, venv' 2>/dev/null ||
    missing "Python $version cannot make virtual environments; install the Debian package $package-venv"
  "$python" -c 'import os, sysconfig as s; os.stat(os.path.join(s.get_path("include"), "Python.h"))' 2>/dev/null ||
    missing "the headers of Python $version are missing; install the Debian package $package-dev"
  command -v "${CXX:-c++}" >/dev/null || command -v g++ >/dev/null ||
    missing "no C++ compiler found; install the Debian package g++"
  command -v cmake >/dev/null ||
    missing "CMake $CMAKE_NEEDED or newer not found; install the Debian package cmake"
  local found
  found="$(cmake --version | sed -n 's/.*version \([0-9.]*\).*/\1/p')"
  printf '%s\n' $CMAKE_NEEDED "$found" | sort -CV ||
    missing "CMake $found is too old, $CMAKE_NEEDED is needed; install a newer Debian package cmake"
  command -v make >/dev/null || missing "make not found; install the Debian package make"
  [ ! -e "$VENV" ] || [ -d "$KEYS" ] ||
    missing "$VENV exists and was not made by this script; move it away"
}

# --- The steps ------------------------------------------------------------------------------

step() { # step NUMBER TEXT FUNCTION: runs the function quietly, shows the end of its log if it fails
  local log="$BUILD/log/setup-$1.log" start=$SECONDS
  mkdir -p "$BUILD/log"
  printf '[%s/4] %s ... ' "$1" "$2"
  local status=0
  set +e # a function in a condition would go on after an error inside it
  (set -e; "$3") >"$log" 2>&1 </dev/null 9>&-
  status=$?
  set -e
  if [ $status -ne 0 ]; then
    echo "failed"
    tail -n 25 "$log" >&2
    echo "set-up: step $1 ($2) failed; its whole log is $log" >&2
    exit 1
  fi
  echo "$((SECONDS - start)) s"
}

create_venv() {
  rm -rf "$VENV"
  mkdir -p "$KEYS" # first, so that an interrupted .venv is known as this script's own
  "$python" -m venv "$VENV"
  echo "$version" >"$KEYS/python"
  echo "$ROOT" >"$KEYS/root"
}

# Every archive must have a hash that is written there.
pip_install() {
  "$VENV/bin/python" -m pip install --disable-pip-version-check --no-input --progress-bar off \
    --require-hashes "$@"
}

install_requirements() {
  rm -f "$KEYS"/{requirements,workspace,kernels,web}
  pip_install -r "$ROOT/requirements-pip.txt"
  pip_install -r "$ROOT/requirements.txt" -r "$ROOT/requirements-build.txt" \
    -r "$ROOT/requirements-study.txt" -r "$ROOT/requirements-test.txt"
  echo "$requirements" >"$KEYS/requirements"
}

install_web() {
  rm -f "$KEYS/web"
  pip_install -r "$ROOT/requirements-web.txt"
  web_key >"$KEYS/web"
}

build_workspace() {
  [ -s "$KEYS/workspace" ] || rm -rf "$BUILD/colcon"
  rm -f "$KEYS/workspace" "$KEYS/kernels"
  export VIRTUAL_ENV="$VENV" PATH="$VENV/bin:$PATH" AMENT_PREFIX_PATH="$VENV"
  export COLCON_HOME="$BUILD/colcon_home" COLCON_LOG_PATH="$BUILD/log/colcon"
  cd "$ROOT"
  local packages warming=""
  if [ $warm = yes ]; then # it takes one core, the C++ of the messages the others
    printf -v packages '%s:' "$SRC"/*
    PYTHONPATH="$packages" python -m tombo_bringup.warmup >"$BUILD/log/setup-kernels.log" 2>&1 &
    warming=$!
    trap 'kill $warming 2>/dev/null || true' EXIT
  fi
  python -m colcon build --base-paths tombo_ws/src scripts/wheels --build-base build/colcon \
    --merge-install --install-base "$VENV" --symlink-install \
    --event-handlers status- desktop_notification- console_cohesion+ \
    --cmake-args -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
    "-DPython3_EXECUTABLE=$VENV/bin/python"
  # colcon leaves it to its setup.bash to put these on the paths; here nothing need be sourced.
  local site package
  site="$(python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')"
  ls -d "$SRC"/*/setup.py | sed 's|/setup.py$||' >"$KEYS/workspace.pth"
  mv "$KEYS/workspace.pth" "$site/tombo_workspace.pth"
  while read -r package; do
    package="$(basename "$package")"
    ln -sfn "$BUILD/colcon/$package/$package.egg-info" "$site/$package.egg-info"
  done <"$site/tombo_workspace.pth"
  # Not a link: the script's own first line cannot name an interpreter in a folder with a space.
  # Ctrl-C is held back until start.py obeys it: while Python starts it would print a traceback.
  local hold=""
  if env --block-signal=INT true 2>/dev/null; then hold="env --block-signal=INT "; fi
  rm -f "$VENV/bin/tombo"
  printf '#!/bin/sh\nexec %s"%s" -P "%s" "$@"\n' "$hold" \
    "$VENV/bin/python" "$SRC/tombo_bringup/tombo_bringup/start.py" >"$VENV/bin/tombo"
  chmod +x "$VENV/bin/tombo"
  [ -z "$warming" ] || wait "$warming" || true # step 4 does again, and shows, what failed
  trap - EXIT
  echo "$workspace" >"$KEYS/workspace"
}

compile_kernels() { # in a first build there is hardly a thing left to do
  "$VENV/bin/python" -m tombo_bringup.warmup
  echo "$compiled" >"$KEYS/kernels"
}

look || exit 0
mkdir -p "$BUILD"
exec 9>"$BUILD/.setup.lock"
if ! flock -n 9; then
  echo "set-up: another one is running, waiting for it"
  flock 9
  look || exit 0
fi
[ $build = no ] || check_system
trap 'echo; echo "set-up: interrupted; the next run goes on from here" >&2; exit 130' INT TERM
[ $make_venv = no ] || step 1 "making .venv with Python $version" create_venv
[ $install = no ] || step 2 "installing the pinned requirements (1 GB on disk)" install_requirements
[ $browser = no ] || step 2 "installing what the pages in a browser need (100 MB on disk)" install_web
[ $build = no ] || step 3 "building the workspace, and kernels beside it" build_workspace
[ $warm = no ] || step 4 "compiling the numerical kernels" compile_kernels
