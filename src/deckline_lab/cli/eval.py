"""`deckline eval`: each command is imported when it is chosen, as all of them together are most of the lab."""

COMMANDS = {
    "chain": "deckline_lab.evaluation.chain:chain",
    "recording": "deckline_lab.evaluation.chain:recording",
    "labels": "deckline_lab.evaluation.label_errors:labels",
    "flicker": "deckline_lab.evaluation.flicker:flicker",
    "ablation": "deckline_lab.ablation.table:ablation",
    "dehazing": "deckline_lab.evaluation.dehazing:dehazing",
    "detection": "deckline_lab.evaluation.detection:detection",
    "detectors": "deckline_lab.evaluation.detection:detectors",
    "integrity": "deckline_lab.evaluation.integrity_runs:integrity",
    "joined": "deckline_lab.evaluation.joined:joined",
    "localization": "deckline_lab.evaluation.localization:localization",
    "picture": "deckline_lab.evaluation.picture_alone:picture",
    "report": "deckline_lab.evaluation.tables:report",
}
EXAMPLES = {
    "deckline eval": ("deckline eval chain --frames 50 --json figures/chain.json", "deckline eval report figures"),
    "deckline eval chain": ("deckline eval chain --frames 50", "deckline eval chain --preset cvn --out scores"),
    "deckline eval recording": (
        "deckline eval recording flights/first",
        "deckline eval recording flights/first --dehazer none --json figures/first.json",
    ),
    "deckline eval labels": ("deckline eval labels photos", "deckline eval labels photos --detector mine/detect.onnx"),
    "deckline eval detection": (
        "deckline eval detection --frames 50 --preset paper cvn",
        "deckline eval detection flights/first --out scores --worst 5",
    ),
    "deckline eval detectors": (
        "deckline eval detectors --frames 50 --detector hybrid ufld",
        "deckline eval detectors flights/first --dehazer none coarse-t",
    ),
    "deckline eval dehazing": (
        "deckline eval dehazing data/test --cost",
        "deckline eval dehazing photographs --dehazer geometry mine/dehaze.onnx --blind sheets",
    ),
    "deckline eval flicker": (
        "deckline eval flicker flights/first",
        "deckline eval flicker flights/first --dehazer coarse-t --every 2",
    ),
    "deckline eval ablation": (
        "deckline eval ablation data --out ablation --steps 3000",
        "deckline eval ablation data --out ablation --minutes 60",
    ),
    "deckline eval joined": ("deckline eval joined", "deckline eval joined --visibility 300 200 --range-m 200"),
    "deckline eval localization": (
        "deckline eval localization --points --approaches 20",
        "deckline eval localization --approaches 4 --out table6",
    ),
    "deckline eval integrity": (
        "deckline eval integrity --jobs 0 --out faults",
        "deckline eval integrity --runs 5 --nominal 20 --sea-state 4",
    ),
    "deckline eval picture": (
        "deckline eval picture flights/first flights/second",
        "deckline eval picture views --frames single --width unknown",
    ),
    "deckline eval report": (
        "deckline eval report figures",
        "deckline eval report figures --out docs/results.md",
    ),
}
