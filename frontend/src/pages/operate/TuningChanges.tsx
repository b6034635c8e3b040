/** Saved, in force and staged tuning side by side; staged λ are applied, tried for a while, or dropped. */

import { Button, Switch } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Shown } from "../../components/Absent";
import { NumberField } from "../../components/NumberField";
import { Refusal } from "../../components/Refusal";
import { SignalName } from "../../components/SignalName";
import { UndoTuning } from "../../components/UndoTuning";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { notANumber } from "../../samples/number";
import { useAngles } from "../../service/angles";
import { useEndTrial, useSaveTuning, useSetTuning, useTryTuning, useUndo } from "../../service/commands";
import { fieldEntry } from "../../service/fieldHelp";
import { savedTuningQuery } from "../../service/queries";
import { lastRefusal, RefusedFields } from "../../service/refusedFields";
import { ON_TRIAL, whyNoRejection } from "../../service/retuning";
import { isNumberOrText, useDraft } from "../../service/useDraft";
import { useNoControl } from "../../service/useNoControl";
import type { LambdaName, Staging } from "../../service/useStagedTuning";
import type { SavedTuning, Trial, Tuning } from "../../wire/types";
import styles from "./TuningChanges.module.css";

/** Every part of a tuning but the bank, for which it is saved: what differs in one of them is another tuning. */
const PARTS = [
  ["lam_q", "λ_q"],
  ["lam_S", "λ_S"],
  ["lam_motor", "λ_motor"],
  ["b", "b"],
  ["interpolate", "entries"],
  ["motion", "motion"],
  ["u_plan", "U_plan"],
  ["k_ext", "k_ext"],
] as const;
const DECIMALS = 3;
const DECIMALS_OF_MOTOR = 4;
const TRIAL_S = 10;

interface TuningChangesProps {
  readonly tuning: Tuning;
  readonly staged: Staging;
  /** Why nothing of the tuning can be changed now; null where it can. */
  readonly locked: string | null;
}

export function TuningChanges({ tuning, staged, locked }: TuningChangesProps) {
  const angles = useAngles();
  const trial = useLive((live) => live.state?.trial ?? null);
  const { data: saved, error: unread } = useQuery(savedTuningQuery(tuning.bank?.id ?? null));
  const set = useSetTuning();
  const save = useSaveTuning();
  const tryOut = useTryTuning();
  const end = useEndTrial();
  const undo = useUndo();
  const noControl = useNoControl();
  const length = useDraft<number | string>("length of a trial", TRIAL_S, isNumberOrText);
  const seconds = length.value;
  const unlearned = useLive((live) => whyNoRejection(live.state, saved?.k_ext));
  const changed = saved !== undefined && PARTS.some(([name]) => saved[name] !== tuning[name]);
  const something = Object.keys(staged.values).length > 0;
  const failure = lastRefusal(set, save, tryOut, end, undo);
  const about = [...PARTS.map(([name]) => tuning[name]), seconds];
  const offersTrial = staged.staging && trial === null;
  const odd =
    offersTrial && typeof seconds !== "number" ? `Length of the trial: ${notANumber(seconds)}.` : null;
  const busy = set.isPending || save.isPending || tryOut.isPending || end.isPending;

  return (
    <section className={styles.changes} aria-label="Changes of the tuning">
      <table className={styles.table} aria-label="Saved, in force and staged">
        <thead>
          <tr>
            <th scope="col">Setting</th>
            <th scope="col">saved</th>
            <th scope="col">in force</th>
            <th scope="col">staged</th>
          </tr>
        </thead>
        <tbody>
          {PARTS.map(([name, symbol]) => (
            <tr key={name}>
              <th scope="row">
                <SignalName name={symbol} />
              </th>
              <td>
                <Shown value={saved?.[name]} why={unread?.message ?? "not read yet"}>
                  {(value) => inWords(name, value)}
                </Shown>
              </td>
              <td data-differs={saved !== undefined && saved[name] !== tuning[name]}>
                {inWords(name, tuning[name])}
              </td>
              <td data-differs={isStaged(name) && staged.values[name] !== undefined}>
                <Shown
                  value={isStaged(name) ? staged.values[name] : undefined}
                  why={isStaged(name) ? "nothing is staged" : "cannot be staged"}
                >
                  {(value) => inWords(name, value)}
                </Shown>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      <RefusedFields error={odd === null ? failure : null} about={about}>
        <div className={styles.decide}>
          <div className={styles.actions}>
            <Button
              variant="default"
              size="compact-xs"
              disabled={!changed || busy || locked !== null || unlearned !== null || trial !== null}
              title={trial === null ? (unlearned ?? origin(saved)) : ON_TRIAL}
              onClick={() =>
                saved && set.mutate(Object.fromEntries(PARTS.map(([name]) => [name, saved[name]])))
              }
            >
              Revert to saved
            </Button>
            <Button
              variant="default"
              size="compact-xs"
              disabled={!changed || busy || trial !== null}
              {...(trial === null ? {} : { title: ON_TRIAL })}
              onClick={() => save.mutate()}
            >
              Save
            </Button>
            <UndoTuning undo={undo} size="compact-xs" />
            <Switch
              size="xs"
              label="Stage changes"
              checked={staged.staging}
              disabled={trial !== null || something}
              {...(something ? { title: "Apply or discard the staged values first." } : {})}
              onChange={(event) => staged.turn(event.currentTarget.checked)}
            />
          </div>
          {trial !== null && (
            <TrialRow
              trial={trial}
              tuning={tuning}
              locked={busy || noControl !== null}
              onEnd={(keep) => end.mutate(keep)}
            />
          )}
          {offersTrial && (
            <div className={styles.actions}>
              <Button
                size="compact-xs"
                disabled={!something || busy || locked !== null}
                onClick={() => set.mutate(staged.values, { onSuccess: staged.discard })}
              >
                Apply
              </Button>
              <Button
                variant="default"
                size="compact-xs"
                disabled={!something || busy || locked !== null || typeof seconds !== "number"}
                onClick={() =>
                  typeof seconds === "number" && tryOut.mutate({ ...staged.values, duration_s: seconds })
                }
              >
                Try for
              </Button>
              <NumberField
                aria-label="Length of the trial [s]"
                entry={fieldEntry("tuning.duration_s", angles)}
                place="duration_s"
                saidAt="refusal-of-tuning"
                size="xs"
                w={54}
                value={seconds}
                onChange={length.set}
                styles={{ input: { height: 22, minHeight: 22 } }}
              />
              <span>s</span>
              <Button variant="default" size="compact-xs" disabled={!something} onClick={staged.discard}>
                Discard
              </Button>
            </div>
          )}
          <Refusal
            id="refusal-of-tuning"
            error={odd === null ? failure : null}
            about={about}
            text={odd ?? locked}
            forFields
          />
        </div>
      </RefusedFields>
    </section>
  );
}

interface TrialRowProps {
  readonly trial: Trial;
  readonly tuning: Tuning;
  /** Whether the trial cannot be ended from this page now. */
  readonly locked: boolean;
  onEnd(keep: boolean): void;
}

function TrialRow({ trial, tuning, locked, onEnd }: TrialRowProps) {
  const others = PARTS.filter(([name]) => !isStaged(name) && trial[name] !== tuning[name]);
  return (
    <div className={styles.actions}>
      <output aria-label="Trial" className={styles.trial}>
        On trial: back to {fixed(trial.lam_q, DECIMALS)}, {fixed(trial.lam_S, DECIMALS)} s
        {others.map(([name, symbol]) => `, ${symbol} ${inWords(name, trial[name])}`)} in{" "}
        {fixed(Math.ceil(trial.remaining_s), 0)} s
      </output>
      <Button size="compact-xs" disabled={locked} onClick={() => onEnd(true)}>
        Keep
      </Button>
      <Button variant="default" size="compact-xs" disabled={locked} onClick={() => onEnd(false)}>
        Revert now
      </Button>
    </div>
  );
}

function origin(saved: SavedTuning | undefined): string {
  if (saved?.who) return `Saved by ${saved.who}`;
  return saved?.moved
    ? `Nothing was saved yet; ${saved.moved}`
    : "The method's defaults: nothing was saved yet";
}

type Part = (typeof PARTS)[number][0];

function isStaged(name: Part): name is LambdaName {
  return name === "lam_q" || name === "lam_S";
}

function inWords(name: Part, value: number | boolean | string): string {
  if (typeof value === "string") return value;
  if (typeof value === "boolean") return value ? "interpolating" : "switching";
  if (name === "u_plan") return `${fixed(value, 1)} V`;
  if (name === "k_ext") return value === 0 ? "none" : fixed(value, 2);
  if (name === "b") return fixed(value, DECIMALS);
  return `${fixed(value, name === "lam_motor" ? DECIMALS_OF_MOTOR : DECIMALS)} s`;
}
