import { Button, Tooltip } from "@mantine/core";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { usePages } from "../../components/Navigation";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { capital, fixed, heading } from "../../samples/format";
import { angleWithUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useSetMode } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { describeMotion } from "../../service/api/tuning";
import { useMayCommand, useWhyNoControl } from "../../service/control/control";
import type { Mode, State } from "../../wire/types";
import pageStyles from "../Page.module.css";
import operateStyles from "./Operate.module.css";
import { TEXTS } from "./texts";

/** Card that changes the mode: legal modes can be pressed, the others show the reason in a tooltip. */

const MOVES: readonly { mode: Mode; name: string; meaning: string }[] = [
  { mode: "pretension", name: TEXTS.pretension, meaning: TEXTS.pretensionMeaning },
  { mode: "run", name: TEXTS.run, meaning: TEXTS.runMeaning },
  { mode: "compliance", name: TEXTS.compliance, meaning: TEXTS.complianceMeaning },
  { mode: "stopping", name: TEXTS.softStop, meaning: TEXTS.softStopMeaning },
  { mode: "off", name: TEXTS.off, meaning: TEXTS.offMeaning },
];

/** Tooltips open left of the card, so that they cover neither its title nor a button that stops. */
const COLUMNS = 3;
const COLUMN_PX = 102;
const CARD_OFFSET_PX = 24;

export function ModeCard() {
  const state = useLive((live) => live.state);
  const setMode = useSetMode();
  const noControl = useWhyNoControl();
  return (
    <Card title={TEXTS.mode}>
      {/* biome-ignore lint/a11y/useSemanticElements: the buttons act at once; they are not a form */}
      <div className={operateStyles.moves} role="group" aria-label={TEXTS.changeMode}>
        {MOVES.map(({ mode, name, meaning }, index) => {
          const reason = noControl ?? whyNot(state, mode);
          return (
            <Tooltip
              key={mode}
              label={reason ?? meaning}
              position="left"
              offset={CARD_OFFSET_PX + (index % COLUMNS) * COLUMN_PX}
              openDelay={300}
              middlewares={{ flip: false, shift: true }}
            >
              <Button
                px={4}
                variant={state?.mode === mode ? "filled" : "default"}
                aria-pressed={state?.mode === mode}
                aria-disabled={reason !== null}
                data-disabled={reason !== null && state?.mode !== mode ? true : undefined}
                loading={setMode.isPending && setMode.variables === mode}
                onClick={(event) => {
                  if (reason === null) setMode.mutate(mode);
                  else event.preventDefault();
                }}
              >
                {name}
              </Button>
            </Tooltip>
          );
        })}
      </div>
      {isUnready(state) && noControl === null ? (
        <Unready why={state.unready} />
      ) : (
        <Refusal error={setMode.error} text={noControl} />
      )}
    </Card>
  );
}

/** Replaces the refusal until pretension is possible, because no command can be sent before. */
function Unready({ why }: { why: string }) {
  const offered = usePages().some(({ path }) => path === "/bring-up");
  return (
    <p className={operateStyles.unready}>
      {fillText(TEXTS.noPretensionYet, { reason: capital(why) })}{" "}
      {offered && <Link href="/bring-up">{TEXTS.goToBringUp}</Link>}
    </p>
  );
}

/** Whether the plant requires a step before pretension. */
function isUnready(state: State | null): state is State {
  return state?.mode === "off" && state.unready !== "";
}

/** Returns the reason why a mode cannot be entered now; null if it can. */
export function whyNot(state: State | null, mode: Mode): string | null {
  if (state === null) return TEXTS.stateUnknown;
  if (state.mode === mode) return fillText(TEXTS.alreadyInMode, { mode: heading(mode) });
  if (state.legal_modes.includes(mode)) return null;
  if (state.mode === "tripped") return TEXTS.faultLatched;
  if (state.mode === "stopping") return TEXTS.softStopInProgress;
  if (isUnready(state) && mode !== "stopping") return `${capital(state.unready)}.`;
  if (state.mode === "off" && mode !== "stopping") return TEXTS.tendonsSlack;
  if (state.mode === "pretension" && !state.pretension_done) return TEXTS.pretensionNotReached;
  if (state.task?.phase === "paused") return TEXTS.runsPaused;
  const legal = MOVES.filter((move) => state.legal_modes.includes(move.mode)).map(({ name }) => name);
  return fillText(TEXTS.modeNotPossible, {
    mode: heading(state.mode),
    modes: legal.join(", ") || TEXTS.onlyStop,
  });
}

/** Button that enters the mode which a refused command requires. */

/** Purpose: a run requires pretension ("start"), a change of parameters requires the motors off ("off"). */
type Need = "start" | "off";

const NAMES = { pretension: TEXTS.pretension, stopping: TEXTS.softStop } as const;

export function NextMode({ need }: { need: Need }) {
  const mode = useLive((live) => nextMode(live.state, need));
  const noControl = useWhyNoControl();
  const may = useMayCommand();
  const set = useSetMode();
  if (mode === null || noControl !== null || may === false) return null;
  return (
    <>
      <Button
        size="compact-xs"
        ml={6}
        variant="default"
        loading={set.isPending}
        onClick={() => set.mutate(mode)}
      >
        {NAMES[mode]}
      </Button>
      {set.error !== null && <span> {set.error.message}</span>}
    </>
  );
}

/** Returns the mode to enter first; null if no mode helps now. Pure. */
export function nextMode(state: State | null, need: Need): keyof typeof NAMES | null {
  if (state === null || state.task !== null || state.trial !== null) return null;
  const wanted = need === "start" ? "pretension" : "stopping";
  if ((state.mode === "off") !== (need === "start")) return null;
  return state.legal_modes.includes(wanted) ? wanted : null;
}

/** Replaces the controls for a viewer: the active values, read-only. */

export function ViewOnly() {
  const angles = useAngleUnit();
  const state = useLive((live) => live.state);
  if (state === null) return null;
  const { references, tuning } = state;
  return (
    <Card title={TEXTS.activeValues}>
      <dl className={pageStyles.facts}>
        <dt>{references.in_force ? TEXTS.positionReference : TEXTS.positionMeasured}</dt>
        <dd>{angleWithUnit(references.q_ref, 1, angles)}</dd>
        <dt>{references.in_force ? TEXTS.stiffnessReference : TEXTS.stiffnessMeasured}</dt>
        <dd>{references.S_ref === null ? TEXTS.noStiffness : `${fixed(references.S_ref, 2)} N·m/rad`}</dd>
        <dt>λ_q, λ_S, λ_motor</dt>
        <dd>
          {fixed(tuning.lam_q, 3)}, {fixed(tuning.lam_S, 3)}, {fixed(tuning.lam_motor, 4)} s
        </dd>
        <dt>{TEXTS.motion}</dt>
        <dd>{describeMotion(tuning.motion, tuning.u_plan)}</dd>
        <dt>{TEXTS.rejection}</dt>
        <dd>
          {tuning.k_ext > 0
            ? fillText(TEXTS.rejectionOn, { gain: fixed(tuning.k_ext, 2) })
            : TEXTS.rejectionOff}
        </dd>
        <dt>{TEXTS.gains}</dt>
        <dd>
          {tuning.bank === null
            ? TEXTS.gainsGeometric
            : fillText(TEXTS.gainsOfBank, { bank: tuning.bank.name, version: tuning.bank.version })}
        </dd>
      </dl>
      <p className={pageStyles.dim}>{TEXTS.signedInAsViewer} </p>
    </Card>
  );
}
