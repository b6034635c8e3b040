/** What can be done with the stretch in sight: measure, figures, spectrum, picture, data. */

import { ActionIcon, Button, Menu, Tooltip } from "@mantine/core";
import type { ReactNode } from "react";
import { TbCameraDown, TbChartHistogram, TbFileTypeCsv, TbRulerMeasure, TbSum } from "react-icons/tb";
import styles from "./Charts.module.css";
import type { PictureKind } from "./export";

interface ChartToolsProps {
  readonly measuring: boolean;
  readonly figures: boolean;
  /** Of what the service has every sample; null where the page has all that there is. */
  readonly dataOf: string | null;
  onMeasure(): void;
  onFigures(): void;
  onSpectrum(): void;
  onPicture(kind: PictureKind): void;
  onData(): void;
}

export function ChartTools(props: ChartToolsProps) {
  const { measuring, figures, dataOf, onMeasure, onFigures, onSpectrum, onPicture, onData } = props;
  return (
    <span className={styles.tools}>
      <Button
        px={8}
        variant={measuring ? "light" : "default"}
        aria-pressed={measuring}
        leftSection={<TbRulerMeasure size={14} />}
        onClick={onMeasure}
      >
        Measure
      </Button>
      <Tool
        name="Statistics"
        hint="Statistics of the visible range, or between the cursors"
        pressed={figures}
        onClick={onFigures}
      >
        <TbSum size={16} />
      </Tool>
      <Tool name="Spectrum" hint="Spectrum of the visible range, or between the cursors" onClick={onSpectrum}>
        <TbChartHistogram size={16} />
      </Tool>
      <Menu position="top" withinPortal>
        <Menu.Target>
          <ActionIcon
            variant="default"
            size={30}
            aria-label="Save picture"
            title="Picture of what is in sight"
          >
            <TbCameraDown size={16} />
          </ActionIcon>
        </Menu.Target>
        <Menu.Dropdown>
          <Menu.Item onClick={() => onPicture("svg")}>SVG, vectors</Menu.Item>
          <Menu.Item onClick={() => onPicture("pdf")}>PDF, 180 mm, vectors with fonts</Menu.Item>
          <Menu.Item onClick={() => onPicture("png")}>PNG, 180 mm at 300 dpi</Menu.Item>
        </Menu.Dropdown>
      </Menu>
      <Tool
        name="Save data"
        hint={`${dataOf === null ? "Data" : `Every sample of ${dataOf}`} in the visible range, or between the cursors (CSV, SI)`}
        onClick={onData}
      >
        <TbFileTypeCsv size={16} />
      </Tool>
    </span>
  );
}

interface ToolProps {
  readonly name: string;
  readonly hint: string;
  readonly pressed?: boolean;
  readonly children: ReactNode;
  onClick(): void;
}

function Tool({ name, hint, pressed, children, onClick }: ToolProps) {
  return (
    <Tooltip label={hint} position="top">
      <ActionIcon
        variant={pressed === true ? "light" : "default"}
        size={30}
        aria-label={name}
        {...(pressed === undefined ? {} : { "aria-pressed": pressed })}
        onClick={onClick}
      >
        {children}
      </ActionIcon>
    </Tooltip>
  );
}
