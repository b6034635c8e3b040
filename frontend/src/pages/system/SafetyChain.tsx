/** The safety chain in order, each link as it stands now; each watches the one before it. */

import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { entryOf } from "../../service/glossary";
import { Facts } from "./Facts";

export function SafetyChain() {
  const chain = useLive((live) => live.state?.chain);
  return (
    <Facts
      title="Safety chain"
      facts={(chain ?? []).map((link) => [
        entryOf(`chain:${link.name}`)?.term ?? link.name,
        <Verdict key={link.name} good={link.good} of={`chain:${link.name}`}>
          {link.says}
          {link.silent_s !== null && `, ${fixed(link.silent_s, 1)} s ago`}
        </Verdict>,
      ])}
    />
  );
}
