/** What can be taken home from a run. */

import { Button } from "@mantine/core";
import { TbDownload, TbExternalLink } from "react-icons/tb";

const DATA = [
  { format: "csv", label: "Data (CSV)" },
  { format: "parquet", label: "Data (Parquet)" },
  { format: "mat", label: "Data (MAT)" },
  { format: "mcap", label: "Data (MCAP)" },
] as const;

export function Downloads({ run, report }: { run: number; report: boolean }) {
  return (
    <>
      {report && (
        <>
          <Button
            component="a"
            href={`./api/runs/${run}/report.html`}
            target="_blank"
            rel="noreferrer"
            variant="default"
            leftSection={<TbExternalLink size={14} />}
          >
            Report (HTML)
          </Button>
          <Button
            component="a"
            href={`./api/runs/${run}/report.pdf`}
            download
            variant="default"
            leftSection={<TbDownload size={14} />}
          >
            Report (PDF)
          </Button>
        </>
      )}
      {DATA.map(({ format, label }) => (
        <Button
          key={format}
          component="a"
          href={`./api/runs/${run}/data.${format}`}
          download
          variant="default"
          leftSection={<TbDownload size={14} />}
        >
          {label}
        </Button>
      ))}
      <Button
        component="a"
        href={`./api/runs/${run}/bundle.zip`}
        download
        variant="default"
        leftSection={<TbDownload size={14} />}
        title="The run with all that it came from, for another installation: sinew runs import"
      >
        Bundle
      </Button>
      <Button
        component="a"
        href="./api/runs/foxglove-layout.json"
        download
        variant="default"
        leftSection={<TbDownload size={14} />}
        title="Shows the MCAP in Foxglove and Lichtblick"
      >
        Layout
      </Button>
    </>
  );
}
