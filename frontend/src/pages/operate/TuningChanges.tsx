/** Saved, in force and staged λ side by side; staged ones are applied, tried for a while, or dropped. */

import { Button, NumberInput, Switch } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { Refusal } from "../../components/Refusal";
import { SignalName } from "../../components/SignalName";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { useEndTrial, useSaveTuning, useSetTuning, useTryTuning } from "../../service/commands";
import { savedTuningQuery } from "../../service/queries";
import type { Staging } from "../../service/useStaged";
import type { Trial, Tuning } from "../../wire/types";
import styles from "./TuningChanges.module.css";

const NAMES = [
  ["lam_q", "λ_q"],
  ["lam_S", "λ_S"],
] as const;
const DECIMALS = 3;
const TRIAL_S = 10;

export function TuningChanges({ tuning, staged }: { tuning: Tuning; staged: Staging }) {
  const trial = useLive((live) => live.state?.trial ?? null);
  const { data: saved } = useQuery(savedTuningQuery(tuning.bank?.id ?? null));
  const set = useSetTuning();
  const save = useSaveTuning();
  const tryOut = useTryTuning();
  const end = useEndTrial();
  const [seconds, setSeconds] = useState(TRIAL_S);
  const changed = saved !== undefined && NAMES.some(([name]) => saved[name] !== tuning[name]);
  const something = Object.keys(staged.values).length > 0;
  const failure = set.error ?? save.error ?? tryOut.error ?? end.error;
  const busy = set.isPending || save.isPending || tryOut.isPending || end.isPending;

  return (
    <section className={styles.changes} aria-label="Changes of the tuning">
      <table className={styles.table} aria-label="Saved, in force and staged">
        <thead>
          <tr>
            <th scope="col">[s]</th>
            <th scope="col">saved</th>
            <th scope="col">in force</th>
            <th scope="col">staged</th>
          </tr>
        </thead>
        <tbody>
          {NAMES.map(([name, symbol]) => (
            <tr key={name}>
              <th scope="row">
                <SignalName name={symbol} />
              </th>
              <td>{fixed(saved?.[name], DECIMALS)}</td>
              <td data-differs={saved !== undefined && saved[name] !== tuning[name]}>
                {fixed(tuning[name], DECIMALS)}
              </td>
              <td data-differs={something}>{fixed(staged.values[name], DECIMALS)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      {trial === null ? (
        <div className={styles.actions}>
          <Button
            variant="default"
            size="compact-xs"
            disabled={!changed || busy}
            title={saved?.who ? `Saved by ${saved.who}` : "The method's defaults: nothing was saved yet"}
            onClick={() =>
              saved && set.mutate({ lam_q: saved.lam_q, lam_S: saved.lam_S, lam_motor: saved.lam_motor })
            }
          >
            Revert to saved
          </Button>
          <Button
            variant="default"
            size="compact-xs"
            disabled={!changed || busy}
            onClick={() => save.mutate()}
          >
            Save
          </Button>
          <Switch
            size="xs"
            label="Stage changes"
            checked={staged.staging}
            onChange={(event) => staged.turn(event.currentTarget.checked)}
          />
        </div>
      ) : (
        <TrialRow trial={trial} busy={busy} onEnd={(keep) => end.mutate(keep)} />
      )}
      {staged.staging && trial === null && (
        <div className={styles.actions}>
          <Button
            size="compact-xs"
            disabled={!something || busy}
            onClick={() => set.mutate(staged.values, { onSuccess: staged.discard })}
          >
            Apply
          </Button>
          <Button
            variant="default"
            size="compact-xs"
            disabled={!something || busy}
            onClick={() => tryOut.mutate({ ...staged.values, duration_s: seconds })}
          >
            Try for
          </Button>
          <NumberInput
            aria-label="Length of the trial [s]"
            size="xs"
            w={54}
            min={1}
            max={600}
            clampBehavior="blur"
            allowDecimal={false}
            hideControls
            value={seconds}
            onChange={(value) => setSeconds(Number(value))}
            styles={{ input: { height: 22, minHeight: 22 } }}
          />
          <span>s</span>
          <Button variant="default" size="compact-xs" disabled={!something} onClick={staged.discard}>
            Discard
          </Button>
        </div>
      )}
      <Refusal text={failure?.message} />
    </section>
  );
}

interface TrialRowProps {
  readonly trial: Trial;
  readonly busy: boolean;
  onEnd(keep: boolean): void;
}

function TrialRow({ trial, busy, onEnd }: TrialRowProps) {
  return (
    <div className={styles.actions}>
      <output aria-label="Trial" className={styles.trial}>
        On trial: back to {fixed(trial.lam_q, DECIMALS)}, {fixed(trial.lam_S, DECIMALS)} s in{" "}
        {fixed(Math.ceil(trial.remaining_s), 0)} s
      </output>
      <Button size="compact-xs" disabled={busy} onClick={() => onEnd(true)}>
        Keep
      </Button>
      <Button variant="default" size="compact-xs" disabled={busy} onClick={() => onEnd(false)}>
        Revert now
      </Button>
    </div>
  );
}
