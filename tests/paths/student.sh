#!/usr/bin/env bash
# A student with the paper: the first five minutes (docs/start.md, its commands come before this), then Table I.
set -eu
stadera reproduce table1 --quick --json table1.json --report table1.html --latex table1.tex
