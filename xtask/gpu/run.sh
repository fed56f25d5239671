#!/bin/sh
# Figures of drawing on this machine's GPU: makes the models, draws them, writes gpu.md and gpu.json. README.md says what it needs.
# Arguments are those of ./gpu_bench (--help lists them).
set -eu
cd "$(dirname "$0")"
: "${TRIANGLES:=16000000}" # of each model
: "${MODELS:=wall fort}"   # kinds of `kilwa synth`; packs in models/ are drawn, too
: "${OUT:=.}"              # folder for gpu.md and gpu.json
mkdir -p models "$OUT"
for model in $MODELS; do
    pack="models/$model-$TRIANGLES.kilwa"
    if [ ! -f "$pack" ]; then
        ./kilwa synth "$model" --triangles "$TRIANGLES" --force -o models/mesh.ply
        ./kilwa build models/mesh.ply -o "$pack"
        rm models/mesh.ply
    fi
done
./gpu_bench --json "$OUT/gpu.json" "$@" models/*.kilwa >"$OUT/gpu.md.part"
{
    cat "$OUT/gpu.md.part"
    printf '\nPacks:\n\n'
    sha256sum models/*.kilwa | sed 's/^/    /'
} >"$OUT/gpu.md"
rm "$OUT/gpu.md.part"
cat "$OUT/gpu.md"
