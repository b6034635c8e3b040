import { Button, Group } from "@mantine/core";
import { useRef } from "react";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { CameraChoice, SceneFrame, sceneAddress } from "../../components/SceneFrame";
import { paintsInSoftware } from "../../drawing/canvas";
import { useLive } from "../../live/react";
import { fillText } from "../../samples/texts";
import { useSceneView } from "../../service/api/preferences";
import { HUES, paintOf } from "../../theme/signals";
import { TriggerCard } from "../system/TriggerCard";
import { TEXTS as SYSTEM } from "../system/texts";
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
import { TEXTS } from "./texts";
import { WallCard } from "./WallCard";

/** Bar with a button per card of the controls that scrolls to the card. */

/** Short forms of titles that are too long for the bar. */
const SHORT: Readonly<Record<string, string>> = { [SYSTEM.trigger]: TEXTS.trigger };

export function CardJumps() {
  const bar = useRef<HTMLElement>(null);
  const pushes = useLive((live) => (live.state?.limits.F_push_max ?? 0) > 0);
  const walls = useLive((live) => live.state?.plant.simulated ?? false);
  const known = useLive((live) => live.state !== null);
  const titles = [
    TEXTS.mode,
    TEXTS.references,
    TEXTS.tuning,
    ...(known ? [TEXTS.touch] : []),
    ...(pushes ? [TEXTS.push] : []),
    ...(walls ? [TEXTS.wall] : []),
    SYSTEM.trigger,
  ];

  function jump(title: string): void {
    const card = bar.current?.parentElement?.querySelector<HTMLElement>(`section[aria-label="${title}"]`);
    if (!card) return;
    card.tabIndex = -1;
    card.focus({ preventScroll: true });
    card.scrollIntoView({ block: "start" });
  }

  return (
    <nav ref={bar} className={operateStyles.jumps} aria-label={TEXTS.controls}>
      {titles.map((title) => (
        <button
          key={title}
          type="button"
          aria-label={fillText(TEXTS.goTo, { card: title })}
          onClick={() => jump(title)}
        >
          {SHORT[title] ?? title}
        </button>
      ))}
    </nav>
  );
}

/** Card with the actuator as a flat drawing or in 3D, which the service serves after sign-in. */

function SceneCard() {
  const { solid, camera, known, toggle, look } = useSceneView(true);
  return (
    <Card
      title={TEXTS.actuator}
      className={operateStyles.scene}
      aside={
        <Group gap={6} wrap="nowrap">
          {solid && <CameraChoice camera={camera} onChange={look} />}
          <Button
            size="compact-xs"
            variant="default"
            disabled={!known}
            title={!solid && paintsInSoftware() ? TEXTS.slow3D : ""}
            onClick={toggle}
          >
            {solid ? TEXTS.showFlat : TEXTS.showIn3D}
          </Button>
        </Group>
      }
    >
      {solid ? (
        <SceneFrame address={sceneAddress("./scene/", camera)} title={TEXTS.view3D} />
      ) : (
        <>
          <ActuatorDrawing />
          <p className={operateStyles.fanKey}>
            <span style={{ background: paintOf(HUES.S) }} aria-hidden="true" /> {TEXTS.fanKey}
          </p>
        </>
      )}
    </Card>
  );
}

/** Page Operate: charts, actuator, map and controls. */

export function OperatePage() {
  const plays = useLive((live) => live.state?.plant.kind === "replay");
  return (
    <div className={operateStyles.page}>
      <h1 className="visually-hidden">{TEXTS.title}</h1>
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

/** Cards that command the plant; a viewer sees the active values instead. */
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
