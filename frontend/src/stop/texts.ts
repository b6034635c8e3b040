/** Texts of STOP, which are part of its own file. */
export const TEXTS = {
  stop: "STOP",
  stops: "Hard stop: zero volts at once, latched (Ctrl/Cmd+Shift+E)",
  pauses: "Pauses playback; no hardware moves (Ctrl/Cmd+Shift+E)",
  sending: "STOP sent, waiting for confirmation…",
  unconfirmed: "STOP NOT CONFIRMED: use the stop at the machine. {reason}",
  unreachable: "The service cannot be reached.",
  refused: "The service answered with status {status}.",
  noProof: "The answer of the service does not confirm the stop.",
  paused: "Playback paused (tick {tick}); no hardware moves",
  proof: "Zero volts in {ticks} · {time} ms (tick {tick})",
  tick: "1 tick",
  ticks: "{count} ticks",
} as const;
