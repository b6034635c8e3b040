/** What the loops do while no bank is in force, and how a bank comes to be. */

import { Link } from "wouter";
import { Card } from "../../components/Card";
import { SignalName } from "../../components/SignalName";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { usePreview, usePreviewedStiffness } from "../../service/usePreview";
import { HUES } from "../../theme/signals";
import type { Tuning } from "../../wire/types";
import { StepPreview } from "../operate/StepPreview";
import page from "../Page.module.css";
import styles from "./DefaultGainsCard.module.css";

const LOOPS = [
  { loop: "position", lam: "lam_q", symbol: "λ_q", hue: HUES.q },
  { loop: "stiffness", lam: "lam_S", symbol: "λ_S", hue: HUES.S },
] as const;

export function DefaultGainsCard() {
  const tuning = useLive((live) => live.state?.tuning);
  return (
    <>
      {tuning !== undefined && tuning.bank === null && <FromGeometry tuning={tuning} />}
      <Card title="From runs to a bank">
        <ol className={styles.steps}>
          <li>
            <Link href="/operate">Wind the tendons</Link> to pretension: an identification starts from there.
          </li>
          <li>
            <Link href="/identify">Identify the actuator</Link> at one tension or at several in turn; each run
            measures how q and S follow, with the error of each number.
          </li>
          <li>
            Tick the runs that are usable, name the bank, and build it. Each entry keeps the way back to its
            samples.
          </li>
          <li>
            Activate it here: the loops change over without a bump, and one press leads back to geometry.
          </li>
        </ol>
      </Card>
    </>
  );
}

function FromGeometry({ tuning }: { tuning: Tuning }) {
  const { lam_q, lam_S, motion, u_plan, k_ext } = tuning;
  const S = usePreviewedStiffness();
  const { preview, stale, missing } = usePreview(
    { lam_q, lam_S, motion, u_plan, k_ext, S, printed: false },
    tuning,
  );
  return (
    <Card title="Gains from geometry" aside={<span className={page.dim}>predicted</span>}>
      <div className={page.halves}>
        {LOOPS.map(({ loop, lam, symbol, hue }) => (
          <div key={loop} className={styles.loop}>
            <SignalName name={symbol} /> = {fixed(tuning[lam], 3)} s
            <StepPreview
              symbol={symbol}
              hue={hue}
              loop={loop}
              preview={preview}
              stale={stale}
              missing={missing}
              present={undefined}
              drafted={false}
              compare={false}
            />
          </div>
        ))}
      </div>
      <p className={page.lead}>
        Computed from the springs, the pulley and the motors as the parameters in force have them. What they
        are on this joint, an identification measures.
      </p>
    </Card>
  );
}
