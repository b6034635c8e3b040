/** Texts of STOP, which the build includes in its file. */
export const TEXTS = {
  stop: "STOP",
  stops: "Hard stop: zero volts immediately, latched (Ctrl/Cmd+Shift+E)",
  pauses: "Pauses playback; no hardware moves (Ctrl/Cmd+Shift+E)",
  sending: "STOP sent, waiting for confirmation…",
  unconfirmed: "STOP NOT CONFIRMED: use the stop at the machine. {reason}",
  unreachable: "The service cannot be reached.",
  refused: "The service responded with status {status}.",
  noProof: "The response of the service does not confirm the stop.",
  paused: "Playback paused (tick {tick}); no hardware moves",
  proof: "Zero volts in {steps} · {time} ms (tick {tick})",
  step: "1 control step",
  steps: "{count} control steps",
} as const;
