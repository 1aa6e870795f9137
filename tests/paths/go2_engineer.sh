#!/usr/bin/env bash
# A Go2 engineer: `pip install .` is done, walk.mcap is a bag of LowState. From README's own log to a model with the payload.
set -eu
stadera identify go2_legs_in_air --robot go2 --report report.html --json legs.json --export go2_drives.yaml
stadera inspect go2
stadera inspect walk.mcap --robot go2
stadera weigh walk.mcap --robot go2 --tare 0:2.5 --legs legs.json --report payload.html --json payload.json \
  --export go2_loaded.urdf
