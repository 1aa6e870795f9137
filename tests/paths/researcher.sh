#!/usr/bin/env bash
# A methods researcher: the two commands of README on logs of their own robot, arrays, an estimator, a comparison, a figure.
set -eu
stadera identify swing.csv --robot robot.urdf --report report.html --export identified.urdf
stadera weigh walk.csv --robot robot.urdf --tare 0:2.5 --report payload.html
python researcher.py
stadera compare walk.csv --robot robot.urdf --methods walking,mine.py:MeanMass --report compared.html \
  --json compared.json --latex compared.tex
