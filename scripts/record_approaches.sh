#!/bin/sh
# Records the flights of docs/experiments/2026-11-approaches-flown.md, some 7,400 frames:
#
#   record_approaches.sh FOLDER [SHIPS [SEEDS]]
#
#   FOLDER/random   40 or SHIPS random ships from 800 to 60 m, 10 Hz, 15 to 70 m/s, visibility 200 to 3000 m; every other
#                   deck moves
#   FOLDER/presets  presets paper and cvn at visibilities of 500, 1000 and 1500 m, from 1.1 times that on, 5 Hz; 2 or SEEDS
#                   approaches each
#   FOLDER/empty    unrelated views without a runway
#
# Poses err as grade "standard" says. A stopped script goes on where it stopped.
set -eu
out=$1 ships=${2:-40} seeds=${3:-2}
: "${DECKLINE:=deckline}"

record() { # FOLDER SEED SPEED HZ START END FLAGS: still air but for a light wind from the right
    folder=$1 seed=$2 speed=$3 rate=$4 start=$5 end=$6
    shift 6
    $DECKLINE sim --trajectory approach --out "$folder" --seed "$seed" --start-m "$start" --end-m "$end" \
        --frames $((rate * (start - end) / speed + 1)) --no-keep-clear "$@" --set \
        flight.speed_m_s="$speed" flight.headwind_m_s=0 flight.crosswind_m_s=3 \
        navigation.position_sigma_m=0.05 navigation.position_bias_m=0.0866 \
        navigation.attitude_sigma_deg=0.02 navigation.attitude_bias_deg=0.098
}

for seed in $(seq 3600 $((3599 + ships))); do
    set -- 70 65 65 60 60 55 50 50 45 40 30 15
    shift $(((seed - 3600) % 12))
    record "$out/random/$seed" "$seed" "$1" 10 800 60 \
        --preset train --visibility 200..3000 --weather.sea-state $((seed % 2 * 4))
done
for visibility in 500 1000 1500; do
    for preset in paper cvn; do
        for seed in $(seq 3620 $((3619 + seeds))); do
            record "$out/presets/$preset-$visibility-$seed" $seed 65 5 $((visibility * 11 / 10)) $((visibility / 4)) \
                --preset $preset --visibility $visibility --weather.sea-state $((seed % 2 * 4))
        done
    done
done
$DECKLINE sim --preset train --trajectory deckless --frames 100 --frames-per-ship 1 --visibility 200..3000 \
    --seed 3630 --no-keep-clear --out "$out/empty"
