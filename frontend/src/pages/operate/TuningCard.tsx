/** λ of both outer loops, with what the loops would do at the value in hand. */

import { useDebouncedValue } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Card } from "../../components/Card";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { previewQuery } from "../../service/queries";
import { HUES } from "../../theme/signals";
import type { Tuning, TuningPreview } from "../../wire/types";
import { LambdaControl } from "./LambdaControl";
import styles from "./Operate.module.css";

const PREVIEW_AFTER_MS = 60;

export function TuningCard() {
  const tuning = useLive((live) => live.state?.tuning);
  const u_max = useLive((live) => live.state?.limits.u_max ?? 0);
  return (
    <Card title="Tuning" aside={<ActiveBank tuning={tuning} />}>
      {tuning ? <Lambdas tuning={tuning} u_max={u_max} /> : <div className={styles.reserveTuning} />}
    </Card>
  );
}

function Lambdas({ tuning, u_max }: { tuning: Tuning; u_max: number }) {
  const [drafts, setDrafts] = useState<{ lam_q?: number | undefined; lam_S?: number | undefined }>({});
  const [asked] = useDebouncedValue(
    { lam_q: drafts.lam_q ?? tuning.lam_q, lam_S: drafts.lam_S ?? tuning.lam_S },
    PREVIEW_AFTER_MS,
  );
  const preview = useQuery(previewQuery(asked.lam_q, asked.lam_S));
  return (
    <>
      <LambdaControl
        name="lam_q"
        symbol="λ_q"
        hue={HUES.q}
        tuning={tuning}
        preview={preview.data?.position}
        onDraft={(lam_q) => setDrafts((before) => ({ ...before, lam_q }))}
      />
      <LambdaControl
        name="lam_S"
        symbol="λ_S"
        hue={HUES.S}
        tuning={tuning}
        preview={preview.data?.stiffness}
        onDraft={(lam_S) => setDrafts((before) => ({ ...before, lam_S }))}
      />
      <StepForecast preview={preview.data} u_max={u_max} />
    </>
  );
}

/** What a large step would ask of motors and tendons. */
function StepForecast({ preview, u_max }: { preview: TuningPreview | undefined; u_max: number }) {
  const saturates = preview !== undefined && preview.u_peak_V >= u_max;
  return (
    <output className={styles.forecast} aria-label="Forecast of a 60° step" data-warn={saturates}>
      60° step: peak {fixed(preview?.u_peak_V, 1)} of {fixed(u_max, 0)} V, tension ≥{" "}
      {fixed(preview?.F_min_N, 1)} N
    </output>
  );
}

function ActiveBank({ tuning }: { tuning: Tuning | undefined }) {
  if (tuning === undefined) return null;
  const { bank, entry, interpolate } = tuning;
  if (bank === null) return <span className={styles.aside}>gains from geometry</span>;
  return (
    <span className={styles.aside}>
      {bank.name} v{bank.version}, entry {interpolate ? entry.toFixed(2) : entry.toFixed(0)}
    </span>
  );
}
