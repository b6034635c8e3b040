/** Player of a replayed recording in place of the plant's controls: position, speed and marks. */

import { ActionIcon, Button, NativeSelect, Slider } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { TbPlayerPauseFilled, TbPlayerPlayFilled } from "react-icons/tb";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive, useNow } from "../../live/react";
import { clockTime } from "../../samples/format";
import { localizeText } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { playedQuery, usePlayerCommand } from "../../service/api/recordings";
import { useMayCommand, useWhyNoControl } from "../../service/control/control";
import { RefusedFields } from "../../service/forms/refusals";
import type { PlayerPosition } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Operate.module.css";
import { TEXTS } from "./texts";

const SPEEDS = [0.25, 0.5, 1, 2, 4];
const STEP_S = 0.001;
const REFRESH_MS = 100;

/** Returns nothing until the service has reported the playback position. */
export function PlayerCard() {
  const player = useLive((live) => live.state?.player ?? null);
  return player === null ? null : <Player player={player} />;
}

function Player({ player }: { player: PlayerPosition }) {
  const order = usePlayerCommand();
  const isViewer = useMayCommand() === false;
  const noControl = useWhyNoControl();
  const locked = isViewer || noControl !== null;
  const t = useTime(player);
  const [dragged, setDragged] = useState<number | null>(null);
  const [wanted, setWanted] = useState(0);
  const [problem, setProblem] = useState<string | null>(null);
  const refusal = problem === null ? order.error : null;
  const about = [player.playing, player.speed, wanted];
  return (
    <Card
      title={TEXTS.player}
      aside={<span className={styles.bounds}>{isViewer ? TEXTS.viewOnlyPlayer : TEXTS.nothingMoves}</span>}
    >
      <RefusedFields error={refusal} about={about}>
        <div className={styles.row}>
          <ActionIcon
            variant="default"
            size={34}
            disabled={locked}
            aria-label={player.playing ? TEXTS.pause : TEXTS.play}
            onClick={() => order.mutate({ playing: !player.playing })}
          >
            {player.playing ? <TbPlayerPauseFilled size={16} /> : <TbPlayerPlayFilled size={16} />}
          </ActionIcon>
          <output className={styles.playerTime} aria-label={TEXTS.playbackPosition}>
            {fillText(TEXTS.positionOf, {
              time: clockTime(dragged ?? t, 0.1),
              duration: clockTime(player.duration_s, 0.1),
            })}
          </output>
          <NativeSelect
            aria-label={TEXTS.playbackSpeed}
            disabled={locked}
            value={String(player.speed)}
            onChange={(event) => order.mutate({ speed: Number(event.currentTarget.value) })}
            data={speedsOf(player).map((speed) => ({ value: String(speed), label: `${speed}×` }))}
          />
        </div>
        <Slider
          size="sm"
          thumbLabel={TEXTS.playbackPosition}
          label={null}
          disabled={locked}
          min={0}
          max={player.duration_s}
          step={STEP_S}
          value={dragged ?? t}
          onChange={setDragged}
          onChangeEnd={(at_s) => order.mutate({ t: at_s }, { onSettled: () => setDragged(null) })}
        />
        {!isViewer && (
          <div className={styles.playerJump}>
            <ValueBox
              label={TEXTS.goToTime}
              unit="s"
              value={wanted}
              decimals={3}
              step={1}
              width={110}
              messageId="refusal-of-player"
              place="t"
              isInForm
              onCommit={setWanted}
              onProblem={setProblem}
            />
            <Button
              size="compact-sm"
              variant="default"
              disabled={locked}
              onClick={() => {
                if (problem === null) order.mutate({ t: wanted });
              }}
            >
              {TEXTS.go}
            </Button>
          </div>
        )}
        <Refusal
          id="refusal-of-player"
          error={refusal}
          about={about}
          forFields
          text={(isViewer ? null : noControl) ?? problem}
        />
      </RefusedFields>
      <Marks at_s={t} locked={locked} onGo={(at_s) => order.mutate({ t: at_s })} />
    </Card>
  );
}

interface MarksProps {
  readonly at_s: number;
  readonly locked: boolean;
  onGo(at_s: number): void;
}

/** List of the recording's marks; highlights the last mark that was passed. */
function Marks({ at_s, locked, onGo }: MarksProps) {
  const angles = useAngleUnit();
  const { data } = useQuery(playedQuery);
  if (data === undefined) return null;
  if (data.marks.length === 0) return <p className={page.dim}>{TEXTS.noMarks}</p>;
  const passed = data.marks.findLastIndex((mark) => mark.t <= at_s);
  return (
    <ul className={styles.playerMarks} aria-label={TEXTS.marks}>
      {data.marks.map((mark, place) => (
        // biome-ignore lint/suspicious/noArrayIndexKey: two marks may have the same time and text, and their order is constant
        <li key={place} aria-current={place === passed ? "true" : undefined}>
          <button type="button" disabled={locked} onClick={() => onGo(Math.max(0, mark.t))}>
            <span>{clockTime(mark.t, 0.1)}</span> {localizeText(mark.text, angles)}
          </button>
        </li>
      ))}
    </ul>
  );
}

/** Returns the playback time, extrapolated between the reports of the service (two per second). */
function useTime(player: PlayerPosition): number {
  const now_ms = useNow(REFRESH_MS);
  const received = useMemo(() => ({ player, at_ms: performance.now() }), [player]);
  if (!player.playing) return player.t;
  const gone_s = (Math.max(0, now_ms - received.at_ms) / 1000) * player.speed;
  return Math.min(player.t + gone_s, player.duration_s);
}

/** Returns the offered speeds, and the active one if another page or a script set it. */
function speedsOf({ speed, speed_min, speed_max }: PlayerPosition): readonly number[] {
  const offered = SPEEDS.filter((one) => one >= speed_min && one <= speed_max);
  return offered.includes(speed) ? offered : [...offered, speed].sort((a, b) => a - b);
}
