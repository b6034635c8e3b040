import { Button, Group } from "@mantine/core";
import { useRef } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { CameraChoice, SceneFrame, sceneAddress } from "../../components/SceneFrame";
import { paintsInSoftware } from "../../drawing/canvas";
import { useLive } from "../../live/react";
import { useSceneView } from "../../service/api/preferences";
import { HUES, paintOf } from "../../theme/signals";
import { TriggerCard } from "../system/TriggerCard";
import { ActuatorDrawing } from "./ActuatorDrawing";
import { ContactCard } from "./ContactCard";
import { DisturbanceCard } from "./DisturbanceCard";
import { LiveCharts } from "./LiveCharts";
import { MapCard } from "./MapCard";
import { ModeCard, ViewOnly } from "./ModeCard";
import operateStyles from "./Operate.module.css";
import { PlayerCard } from "./PlayerCard";
import { ReferencesCard } from "./ReferencesCard";
import { TuningCard } from "./TuningCard";
import { WallCard } from "./WallCard";

/** One press to each card of the controls, however far down it is. */

/** Titles that are too long for the bar. */
const SHORT: Readonly<Record<string, string>> = { "Trigger capture": "Trigger" };

export function CardJumps() {
  const bar = useRef<HTMLElement>(null);
  const pushes = useLive((live) => (live.state?.limits.F_push_max ?? 0) > 0);
  const walls = useLive((live) => live.state?.plant.simulated ?? false);
  const known = useLive((live) => live.state !== null);
  const titles = [
    "Mode",
    "References",
    "Tuning",
    ...(known ? ["Touch"] : []),
    ...(pushes ? ["Push"] : []),
    ...(walls ? ["Wall"] : []),
    "Trigger capture",
  ];

  function jump(title: string): void {
    const card = bar.current?.parentElement?.querySelector<HTMLElement>(`section[aria-label="${title}"]`);
    if (!card) return;
    card.tabIndex = -1;
    card.focus({ preventScroll: true });
    card.scrollIntoView({ block: "start" });
  }

  return (
    <nav ref={bar} className={operateStyles.jumps} aria-label="Controls">
      {titles.map((title) => (
        <button key={title} type="button" aria-label={`Go to ${title}`} onClick={() => jump(title)}>
          {SHORT[title] ?? title}
        </button>
      ))}
    </nav>
  );
}

/** The actuator: flat, or in 3D by the same service behind the same sign-in. */

function SceneCard() {
  const { solid, camera, known, toggle, look } = useSceneView(true);
  return (
    <Card
      title="Actuator"
      className={operateStyles.scene}
      aside={
        <Group gap={6} wrap="nowrap">
          {solid && <CameraChoice camera={camera} onChange={look} />}
          <Button
            size="compact-xs"
            variant="default"
            disabled={!known}
            title={
              !solid && paintsInSoftware()
                ? "This browser paints without a graphics processor: the 3D view will slow this page down."
                : ""
            }
            onClick={toggle}
          >
            {solid ? "Show flat" : "Show in 3D"}
          </Button>
        </Group>
      }
    >
      {solid ? (
        <SceneFrame address={sceneAddress("./scene/", camera)} title="3D view" />
      ) : (
        <>
          <ActuatorDrawing />
          <p className={operateStyles.fanKey}>
            <span style={{ background: paintOf(HUES.S) }} aria-hidden="true" /> deflection by ±2 N·m
          </p>
        </>
      )}
    </Card>
  );
}

/** The operator's page: charts, 3D view, controls. */

export function OperatePage() {
  const plays = useLive((live) => live.state?.plant.kind === "replay");
  return (
    <div className={operateStyles.page}>
      <h1 className="visually-hidden">Operate</h1>
      <div className={operateStyles.charts}>
        <LiveCharts />
      </div>
      <div className={operateStyles.views}>
        <SceneCard />
        <MapCard />
      </div>
      <div className={operateStyles.controls}>{plays ? <PlayerCard /> : <Controls />}</div>
    </div>
  );
}

/** What a plant is told; a viewer reads what is in force. */
function Controls() {
  return (
    <OperatorsOnly otherwise={<ViewOnly />}>
      <CardJumps />
      <ModeCard />
      <ReferencesCard />
      <TuningCard />
      <ContactCard />
      <DisturbanceCard />
      <WallCard />
      <TriggerCard />
    </OperatorsOnly>
  );
}
