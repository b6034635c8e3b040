/** The safety chain in order, each link as it stands now; each watches the one before it. */

import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import type { ChainLink } from "../../wire/types";
import { Facts } from "./Facts";

const NAMES: Record<ChainLink["name"], string> = {
  page: "Page in control",
  service: "Service",
  loop: "Loop process",
  watchdog: "Watchdog, drive-enable",
  safety_module: "Safety module",
};

export function SafetyChain() {
  const chain = useLive((live) => live.state?.chain);
  return (
    <Facts
      title="Safety chain"
      facts={(chain ?? []).map((link) => [
        NAMES[link.name],
        <Verdict key={link.name} good={link.good}>
          {link.says}
          {link.silent_s !== null && `, ${fixed(link.silent_s, 1)} s ago`}
        </Verdict>,
      ])}
    />
  );
}
