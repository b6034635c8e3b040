/** How fresh the page's knowledge is. */

import { age_ms, health, type Link } from "../live/link";
import { age } from "../samples/format";
import { Metric } from "./Metric";

export function LinkStatus({ link, now_ms }: { link: Link; now_ms: number }) {
  const condition = health(link, now_ms);
  const old = age_ms(link, now_ms);
  const value = {
    live: link.latency_ms === null ? "connected" : age(link.latency_ms),
    stale: old === null ? "stale" : `stale ${age(old)}`,
    down: old === null ? "connecting" : `down ${age(old)}`,
  }[condition];
  return (
    <span role="status" aria-label="Link" data-health={condition} style={{ display: "flex" }}>
      <Metric of="timing:latency_ms" value={value} width="11ch" />
    </span>
  );
}
