import { Button, Tooltip } from "@mantine/core";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { usePages } from "../../components/Navigation";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { capital, fixed, heading } from "../../samples/format";
import { angleWithUnit } from "../../samples/quantity";
import { useSetMode } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { describeMotion } from "../../service/api/tuning";
import { useMayCommand, useWhyNoControl } from "../../service/control/control";
import type { Mode, State } from "../../wire/types";
import pageStyles from "../Page.module.css";
import operateStyles from "./Operate.module.css";

/** Moves between modes: only the legal ones can be pressed, the others say why not. */

const MOVES: readonly { mode: Mode; name: string; meaning: string }[] = [
  { mode: "pretension", name: "Pretension", meaning: "Wind both tendons up to 10 N and hold them." },
  { mode: "run", name: "Run", meaning: "Close the loops of position and stiffness; the run is recorded." },
  {
    mode: "compliance",
    name: "Compliance",
    meaning:
      "Open the joint loop: q_ref acts through geometry alone, a push moves the joint. Stiffness stays controlled.",
  },
  {
    mode: "stopping",
    name: "Soft stop",
    meaning: "Bring the joint to rest under tension, then to zero volts.",
  },
  { mode: "off", name: "Off", meaning: "Zero volts; the tendons go slack." },
];

/** Words are shown beside the card: nothing covers its title, or a button that stops. */
const COLUMNS = 3;
const COLUMN_PX = 102;
const BESIDE_CARD_PX = 24;

export function ModeCard() {
  const state = useLive((live) => live.state);
  const setMode = useSetMode();
  const noControl = useWhyNoControl();
  return (
    <Card title="Mode">
      {/* biome-ignore lint/a11y/useSemanticElements: buttons that act at once are no form */}
      <div className={operateStyles.moves} role="group" aria-label="Change mode">
        {MOVES.map(({ mode, name, meaning }, index) => {
          const reason = noControl ?? whyNot(state, mode);
          return (
            <Tooltip
              key={mode}
              label={reason ?? meaning}
              position="left"
              offset={BESIDE_CARD_PX + (index % COLUMNS) * COLUMN_PX}
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

/** In the place of a refusal: nothing can be asked for that could be refused. */
function Unready({ why }: { why: string }) {
  const offered = usePages().some(({ path }) => path === "/bring-up");
  return (
    <p className={operateStyles.unready}>
      No pretension yet. {capital(why)}. {offered && <Link href="/bring-up">Go to Bring-up</Link>}
    </p>
  );
}

/** Whether something has to come before pretension on what is driven. */
function isUnready(state: State | null): state is State {
  return state?.mode === "off" && state.unready !== "";
}

/** Why a mode cannot be entered now; null when it can. */
export function whyNot(state: State | null, mode: Mode): string | null {
  if (state === null) return "The state of the loop is not known yet.";
  if (state.mode === mode) return `The mode is ${heading(mode)} already.`;
  if (state.legal_modes.includes(mode)) return null;
  if (state.mode === "tripped") return "A fault is latched: press Reset first.";
  if (state.mode === "stopping") return "A soft stop is under way; it ends in off by itself.";
  if (isUnready(state) && mode !== "stopping") return `${capital(state.unready)}.`;
  if (state.mode === "off" && mode !== "stopping") return "Tendons are slack: start Pretension first.";
  if (state.mode === "pretension" && !state.pretension_done) return "Pretension is not reached yet.";
  if (state.task?.phase === "paused") return "An order is paused in pretension: go on, or stop softly.";
  const legal = MOVES.filter((move) => state.legal_modes.includes(move.mode)).map(({ name }) => name);
  return `Not possible from ${heading(state.mode)}. Possible now: ${legal.join(", ") || "nothing but STOP"}.`;
}

/** The mode that has to come before what is refused at present, one press away. */

/** What needs a mode: a run needs tension, a change of parameters needs the motors off. */
type Need = "start" | "off";

const NAMES = { pretension: "Pretension", stopping: "Soft stop" } as const;

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

/** The mode to go to first; null where none helps at present. Pure. */
export function nextMode(state: State | null, need: Need): keyof typeof NAMES | null {
  if (state === null || state.task !== null || state.trial !== null) return null;
  const wanted = need === "start" ? "pretension" : "stopping";
  if ((state.mode === "off") !== (need === "start")) return null;
  return state.legal_modes.includes(wanted) ? wanted : null;
}

/** In place of the controls, for those who look on: what is in force, as numbers that cannot be changed. */

export function ViewOnly() {
  const angles = useAngleUnit();
  const state = useLive((live) => live.state);
  if (state === null) return null;
  const { references, tuning } = state;
  return (
    <Card title="In force">
      <dl className={pageStyles.facts}>
        <dt>{references.in_force ? "Position reference" : "Position, without reference"}</dt>
        <dd>{angleWithUnit(references.q_ref, 1, angles)}</dd>
        <dt>{references.in_force ? "Stiffness reference" : "Stiffness, without reference"}</dt>
        <dd>{references.S_ref === null ? "slack: none" : `${fixed(references.S_ref, 2)} N·m/rad`}</dd>
        <dt>λ_q, λ_S, λ_motor</dt>
        <dd>
          {fixed(tuning.lam_q, 3)}, {fixed(tuning.lam_S, 3)}, {fixed(tuning.lam_motor, 4)} s
        </dd>
        <dt>Motion</dt>
        <dd>{describeMotion(tuning.motion, tuning.u_plan)}</dd>
        <dt>Pushes</dt>
        <dd>{tuning.k_ext > 0 ? `rejected by ${fixed(tuning.k_ext, 2)}` : "left to the position loop"}</dd>
        <dt>Gains</dt>
        <dd>{tuning.bank === null ? "from geometry" : `bank ${tuning.bank.name} v${tuning.bank.version}`}</dd>
      </dl>
      <p className={pageStyles.dim}>
        You are signed in as a viewer: you may look at everything and press STOP.
      </p>
    </Card>
  );
}
